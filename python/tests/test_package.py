"""Option sets, environments and wrapper of the package, and that its stubs are true."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import elo
import elo.conformance
import elo.gym
import gymnasium
import numpy as np
import pytest
from conftest import REPOSITORY
from gymnasium.utils.env_checker import check_env

RAPIER = {"kind": "rapier", "robot": "half-cheetah"}


@pytest.fixture
def option_set(quick_run: Path) -> Path:
    return quick_run / "results" / "option_sets" / "maximum_mean"


def test_a_set_is_what_its_files_say(option_set: Path) -> None:
    options = elo.load(option_set)
    assert (len(options), options.steps, options.observation_size) == (3, 8, 26)
    assert options.action_low.tolist() == [-1.0] * 6
    observation = np.zeros(26)
    first, later = options.act(0, observation, 0), options.act(0, observation, 7)
    assert first.shape == (6,) and first.dtype == np.float32 and not np.array_equal(first, later)
    assert [options.termination(1, observation, t) for t in (0, 7, 8)] == [0.0, 0.0, 1.0]
    assert options.interests(observation).tolist() == [1.0, 1.0, 1.0]
    assert repr(options) == "<OptionSet: 3 options of half-cheetah by maximum_mean, T = 8>"
    with pytest.raises(IndexError, match="option 3 of a set of 3"):
        options.act(3, observation, 0)
    with pytest.raises(ValueError, match="has 5 numbers, the set's robot has 26"):
        options.act(0, np.zeros(5), 0)


def test_actions_lie_within_the_bounds(closed_loop_run: Path) -> None:
    """A Gaussian of deviation 1 leaves them often."""
    options = elo.load(closed_loop_run / "results" / "option_sets" / "maximum_mean")
    actions = np.array([options.act(0, np.zeros(26), 0, seed) for seed in range(200)])
    assert (options.action_low <= actions).all() and (actions <= options.action_high).all()
    assert (np.abs(actions) == 1.0).any()


def test_what_is_no_table_or_no_set_is_named(option_set: Path) -> None:
    with pytest.raises(TypeError, match=r"expected a `\[simulator\]` table, such as .*, got 'ant'"):
        elo.gym.make("ant")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="expected a table of a config, .*, got 'a:b'"):
        elo.conformance.metric("a:b")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="`options` is .*, expected an option set"):
        elo.gym.OptionsWrapper(elo.gym.make(RAPIER), str(option_set))  # type: ignore[arg-type]


def test_what_options_cannot_take_is_refused(option_set: Path, closed_loop_run: Path) -> None:
    closed = closed_loop_run / "results" / "option_sets" / "maximum_mean"
    for options in (elo.load(option_set), elo.load(closed)):
        observation = np.zeros(26)
        for call in (options.act, options.termination):
            for option in (-1, 3):
                with pytest.raises(IndexError, match=f"option {option} of a set of 3"):
                    call(option, observation, 0)
            with pytest.raises(ValueError, match="`elapsed` is -1, expected a whole number from 0"):
                call(0, observation, -1)
            with pytest.raises(TypeError):
                call(0.5, observation, 0)
        for seed in (-1, 2**64):
            with pytest.raises(ValueError, match=f"`seed` is {seed}, expected"):
                options.act(0, observation, 0, seed)
        assert np.array_equal(options.act(np.int64(1), observation, np.int64(2), np.int64(3)), options.act(1, observation, 2, 3))
        for number in (np.nan, np.inf):
            observation[7] = number
            for ask in (options.interests, lambda seen: options.act(0, seen, 0), lambda seen: options.termination(0, seen, 0)):
                with pytest.raises(ValueError, match=rf"observation\[7\] is {number}, expected finite numbers"):
                    ask(observation)


def test_a_damaged_or_missing_set_is_refused(option_set: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="there is no folder .*nowhere"):
        elo.load(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="manifest.json"):
        elo.load(tmp_path)
    (tmp_path / "manifest.json").write_bytes((option_set / "manifest.json").read_bytes()[:-40])
    with pytest.raises(ValueError, match="manifest.json"):
        elo.load(tmp_path)
    (tmp_path / "manifest.json").write_bytes((option_set / "manifest.json").read_bytes())
    tensors = bytearray((option_set / "options.safetensors").read_bytes())
    for position in range(0, len(tensors), len(tensors) // 50):
        damaged = tensors.copy()
        damaged[position] ^= 1
        (tmp_path / "options.safetensors").write_bytes(damaged)
        with pytest.raises(ValueError, match="options.safetensors"):
            elo.load(tmp_path)
    (tmp_path / "options.safetensors").write_bytes(tensors)
    assert len(elo.load(tmp_path)) == len(elo.load(option_set))


def test_a_state_that_was_read_is_gone_on_from(option_set: Path) -> None:
    environment, options = elo.gym.Environment(RAPIER), elo.load(option_set)
    observation, _ = environment.reset(seed=3)
    state = environment.state()

    def play(observation: np.ndarray) -> list[tuple[float, list[float]]]:
        seen = []
        for step in range(options.steps):
            observation, reward, *_ = environment.step(options.act(0, observation, step))
            seen.append((reward, observation.tolist()))
        return seen

    first = play(observation)
    again, _ = environment.reset(options={"state": state})
    assert np.allclose(again, observation) and play(again)[0][0] == pytest.approx(first[0][0], abs=1e-6)


def test_states_and_tasks_may_hold_numpys_arrays_and_numbers() -> None:
    environment = elo.gym.Environment(RAPIER, {"electricity_cost": np.float32(-0.5)})
    environment.reset(seed=3)
    state = environment.state()
    first, _ = environment.reset(options={"state": state, "task": {"electricity_cost": -0.25}})
    step = environment.step(np.ones(6, np.float32))
    arrays = {name: np.asarray(value) if isinstance(value, list) else np.int64(value) for name, value in state.items()}
    assert {type(value) for value in arrays.values()} == {np.ndarray, np.int64}
    again, _ = environment.reset(options={"state": arrays, "task": {"electricity_cost": np.float32(-0.25)}})
    assert np.array_equal(again, first)
    assert environment.step(np.ones(6, np.float32))[1] == step[1]
    with pytest.raises(TypeError, match="is set, expected what JSON can hold, or NumPy's arrays and numbers"):
        environment.reset(options={"state": {**state, "positions": {1.0}}})


@pytest.mark.filterwarnings("ignore:.*Box observation space.*")
@pytest.mark.parametrize("engine", ["rapier", "mujoco"])
@pytest.mark.parametrize("robot", ["ant", "half-cheetah", "walker2d"])
def test_environments_pass_gymnasiums_check(engine: str, robot: str) -> None:
    check_env(elo.gym.make({"kind": engine, "robot": robot}).unwrapped, skip_render_check=True)


def test_tasks_price_and_limits_truncate() -> None:
    cheap = elo.gym.make(RAPIER, task={"electricity_cost": 0.0}, max_episode_steps=3)
    dear = elo.gym.make(RAPIER, task={"electricity_cost": -10.0}, max_episode_steps=3)
    cheap.reset(seed=1)
    dear.reset(seed=1)
    action = np.full(6, 0.5, np.float32)
    for step in range(3):
        one, other = cheap.step(action), dear.step(action)
        used = one[4]["reward_terms"]["electricity"]
        assert float(one[1]) - float(other[1]) == pytest.approx(10.0 * used)
        assert one[3] == (step == 2)
    with pytest.raises(ValueError, match="no task parameter"):
        elo.gym.make(RAPIER, task={"colour": 1.0})
    with pytest.raises(ValueError, match="no robot"):
        elo.gym.make({"kind": "rapier", "robot": "unicorn"})


def test_several_at_once() -> None:
    environments = gymnasium.vector.SyncVectorEnv([lambda: elo.gym.make(RAPIER)] * 2)
    observations, _ = environments.reset(seed=1)
    assert observations.shape == (2, 26)
    assert environments.step(environments.action_space.sample())[1].shape == (2,)


def tensors(path: Path) -> dict[str, np.ndarray]:
    """A safetensors file, read by the letter of its format."""
    data = path.read_bytes()
    start = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:start])
    header.pop("__metadata__", None)
    return {
        name: np.frombuffer(data[start + entry["data_offsets"][0] : start + entry["data_offsets"][1]], "<f4").reshape(
            entry["shape"]
        )
        for name, entry in header.items()
    }


def network(found: dict[str, np.ndarray], prefix: str, observation: np.ndarray) -> np.ndarray:
    """What the stored network under `prefix` says, in NumPy: normalised, cut to ±10, tanh after all layers but the last."""
    x = (observation - found[prefix + "observation_mean"]) * found[prefix + "observation_scale"]
    x = np.clip(x, -10.0, 10.0)
    layers = sum(name.startswith(prefix) and name.endswith(".weight") for name in found)
    for layer in range(layers):
        x = x @ found[f"{prefix}layer{layer}.weight"] + found[f"{prefix}layer{layer}.bias"]
        x = np.tanh(x) if layer < layers - 1 else x
    return x


def test_options_with_interests_are_what_their_tensors_say(closed_loop_run: Path) -> None:
    folder = closed_loop_run / "results" / "option_sets" / "maximum_mean"
    options, found = elo.load(folder), tensors(folder / "options.safetensors")
    assert [entry["policy"] for entry in options.manifest["options"]] == ["interest"] * 3
    observation = np.random.default_rng(1).normal(size=26).astype(np.float32)
    interests = [float(np.exp(network(found, f"{i}.log_interest/", observation)[0])) for i in range(3)]
    assert options.interests(observation).tolist() == pytest.approx(interests, rel=1e-4)
    assert len(set(interests)) == 3
    for i in range(3):
        assert options.termination(i, observation, 5) == pytest.approx(float(found[f"{i}.ending"][0]))
        actions = np.array([options.act(i, observation, 0, seed) for seed in range(1000)])
        means, deviations = network(found, f"{i}.policy/", observation), np.exp(found[f"{i}.log_std"])
        # Of a clipped Gaussian.
        draws = means + deviations * np.random.default_rng(3).normal(size=(100_000, len(means)))
        expected = np.clip(draws, options.action_low, options.action_high)
        assert np.all(np.abs(actions.mean(0) - expected.mean(0)) < 5.0 * expected.std(0) / np.sqrt(1000))
        assert actions.std(0) == pytest.approx(expected.std(0), rel=0.15)

    # Drawn by interest: the infant agent.
    generator = np.random.default_rng(2)
    drawn = np.bincount([options.draw(observation, generator) for _ in range(3000)], minlength=3)
    shares = np.array(interests) / sum(interests)
    assert np.all(np.abs(drawn / 3000 - shares) < 5.0 * np.sqrt(shares * (1.0 - shares) / 3000))
    wrapper = elo.gym.OptionsWrapper(Counting(options, 50), options)
    wrapper.reset(seed=1)
    assert {wrapper.draw() for _ in range(200)} == {0, 1, 2}
    assert wrapper.step(wrapper.draw())[4]["steps"] >= 1


class Counting(gymnasium.Env):
    """Pays 1, 2, 3, … and ends after `length` steps."""

    def __init__(self, options: elo.OptionSet, length: int) -> None:
        size = options.observation_size
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = gymnasium.spaces.Box(options.action_low, options.action_high)
        self.length, self.time, self.actions = length, 0, []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time = 0
        return np.zeros(self.observation_space.shape, np.float32), {}

    def step(self, action):
        self.time += 1
        self.actions.append(action)
        observation = np.zeros(self.observation_space.shape, np.float32)
        return observation, float(self.time), self.time >= self.length, False, {"inner": self.time}


def test_the_wrappers_reward_is_the_smdps(option_set: Path) -> None:
    options = elo.load(option_set)
    inner = Counting(options, 12)
    wrapper = elo.gym.OptionsWrapper(inner, options, discount=0.9)
    wrapper.reset(seed=1)
    _, reward, terminated, truncated, info = wrapper.step(2)
    # r_1 + γ r_2 + … over the 8 steps of the option, and γ^8 for what follows.
    assert reward == pytest.approx(sum(0.9**i * (i + 1) for i in range(8)))
    assert (terminated, truncated, info["steps"], info["option"]) == (False, False, 8, 2)
    assert info["discount"] == pytest.approx(0.9**8) and info["return"] == 36.0
    assert all(np.array_equal(a, options.act(2, np.zeros(26), t)) for t, a in enumerate(inner.actions))
    # The second decision is cut short by the end of the episode.
    _, reward, terminated, _, info = wrapper.step(0)
    assert reward == pytest.approx(sum(0.9**i * (i + 9) for i in range(4)))
    assert (terminated, info["steps"], info["inner"]) == (True, 4, 12)


def test_the_wrapper_offers_primitive_actions(option_set: Path) -> None:
    options = elo.load(option_set)
    inner = Counting(options, 40)
    wrapper = elo.gym.OptionsWrapper(inner, options, primitive=True)
    wrapper.reset(seed=1)
    torques = np.linspace(-1, 1, 6)
    _, reward, _, _, info = wrapper.step(np.concatenate([[1, 0, 0, 0], torques]).astype(np.float32))
    assert (reward, info["steps"], info["option"]) == (1.0, 1, -1)
    assert np.allclose(inner.actions[-1], torques)
    assert wrapper.step(np.concatenate([[0, 0, 1, 0], torques]).astype(np.float32))[4]["option"] == 1
    with pytest.raises(ValueError, match="26 observations"):
        elo.gym.OptionsWrapper(gymnasium.make("Pendulum-v1"), options)


def test_the_stubs_are_true(tmp_path: Path) -> None:
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", "/dev/null", "--package", "elo"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout
    compared = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "elo._elo"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert compared.returncode == 0, compared.stdout + compared.stderr


def test_the_versions_are_the_same(elo_program: Path) -> None:
    said = subprocess.run([elo_program, "doctor"], capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[0] == elo._elo.fingerprint()
    assert json.loads(elo._elo.Simulator(json.dumps(RAPIER)).spec())["robot"] == "half-cheetah"
