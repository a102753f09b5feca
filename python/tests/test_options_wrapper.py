"""Environments whose actions are options, and copies of what they are made of."""

from __future__ import annotations

import copy
import functools
import pickle
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import MagicMock

import elo
import elo.gym
import gymnasium
import numpy as np
import pytest
from conftest import REPOSITORY
from gymnasium.utils.env_checker import check_env

RAPIER = {"kind": "rapier", "robot": "half-cheetah"}
QUIET = pytest.mark.filterwarnings("ignore:.*Box (observation|action) space.*", "ignore:.*different from the unwrapped version.*")


@pytest.fixture
def option_set(quick_run: Path) -> Path:
    return quick_run / "results" / "option_sets" / "maximum_mean"


@pytest.fixture
def closed_loop_set(closed_loop_run: Path) -> Path:
    return closed_loop_run / "results" / "option_sets" / "maximum_mean"


def over(folder: Path, **arguments: Any) -> elo.gym.OptionsWrapper:
    return elo.gym.OptionsWrapper(elo.gym.make(RAPIER), elo.load(folder), **arguments)


@QUIET
@pytest.mark.parametrize("engine", ["rapier", "mujoco"])
def test_what_make_gives_passes_gymnasiums_check(engine: str) -> None:
    check_env(elo.gym.make({"kind": engine, "robot": "half-cheetah"}), skip_render_check=True)


@QUIET
@pytest.mark.parametrize("primitive", [False, True])
def test_environments_over_options_pass_gymnasiums_check(closed_loop_set: Path, primitive: bool) -> None:
    check_env(over(closed_loop_set, primitive=primitive), skip_render_check=True)


def test_the_wrapped_environment_begins_where_it_would_alone(closed_loop_set: Path) -> None:
    """Options that draw, and the infant agent's choices, take nothing from its generator."""
    alone, wrapped = elo.gym.make(RAPIER), over(closed_loop_set)
    for seed in (3, None, None):
        expected, _ = alone.reset(seed=seed)
        seen, _ = wrapped.reset(seed=seed)
        assert np.array_equal(expected, seen)
        for _ in range(3):
            if any(wrapped.step(wrapped.draw())[2:4]):
                break


def played(environment: Any, seed: int) -> list[list[float]]:
    environment.reset(seed=seed)
    seen = []
    for option in (0, 1, 2):
        observation, _, terminated, *_ = environment.step(option)
        seen.append(observation.tolist())
        if terminated:
            break
    return seen


def test_a_seed_decides_what_options_draw(closed_loop_set: Path) -> None:
    environment = over(closed_loop_set)
    first = played(environment, 1)
    assert first == played(environment, 1) == played(over(closed_loop_set), 1) != played(environment, 2)


class Telling(gymnasium.Env[Any, Any]):
    """Pays a half of each of two terms a step."""

    control_step = 0.0165

    def __init__(self, options: elo.OptionSet) -> None:
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (options.observation_size,), np.float32)
        self.action_space = gymnasium.spaces.Box(options.action_low, options.action_high)
        self.control_step, self.time = options.control_step, 0

    def _see(self) -> Any:
        return np.zeros(self.observation_space.shape, np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.time = 0
        return self._see(), {}

    def step(self, action: Any) -> Any:
        self.time += 1
        terms = {"time": float(self.time), "one": 1.0}
        return self._see(), 0.5 * (self.time + 1.0), False, False, {"reward_terms": terms}


def test_reward_terms_are_summed_as_the_reward_is(option_set: Path) -> None:
    options = elo.load(option_set)
    wrapper = elo.gym.OptionsWrapper(Telling(options), options, discount=0.9)
    wrapper.reset(seed=1)
    _, reward, _, _, info = wrapper.step(0)
    assert info["reward_terms"] == pytest.approx(
        {"time": sum(0.9**i * (i + 1) for i in range(8)), "one": sum(0.9**i for i in range(8))}
    )
    assert reward == pytest.approx(0.5 * sum(info["reward_terms"].values()))


def test_what_the_options_do_not_fit_is_refused(option_set: Path) -> None:
    options = elo.load(option_set)
    with pytest.raises(ValueError, match=r"expected a Box of actions, got Discrete\(2\)"):
        elo.gym.OptionsWrapper(gymnasium.make("CartPole-v1"), options)
    wide = Telling(options)
    wide.action_space = gymnasium.spaces.Box(2.0 * options.action_low, 2.0 * options.action_high)
    with pytest.raises(ValueError, match="the options' actions lie between"):
        elo.gym.OptionsWrapper(wide, options)
    fast = Telling(options)
    fast.control_step = 0.001
    with pytest.raises(ValueError, match=r"the options act every 0\.\d+ s, the environment every 0\.001 s"):
        elo.gym.OptionsWrapper(fast, options)
    fast.control_step = np.float32(0.001)  # type: ignore[assignment]
    with pytest.raises(ValueError, match=r"the environment every 0\.001\d* s"):
        elo.gym.OptionsWrapper(fast, options)


def test_discounts_that_are_none_are_refused(option_set: Path) -> None:
    options = elo.load(option_set)
    for discount in (0.0, -1.0, 1.5, np.nan):
        with pytest.raises(ValueError, match=f"`discount` is {discount}, expected a number above 0 and at most 1"):
            elo.gym.OptionsWrapper(Telling(options), options, discount=discount)
    undiscounted = elo.gym.OptionsWrapper(Telling(options), options, discount=1.0)
    undiscounted.reset(seed=1)
    _, reward, _, _, info = undiscounted.step(0)
    assert reward == info["return"]


def test_actions_that_are_none_are_refused(option_set: Path) -> None:
    options = elo.load(option_set)
    wrapper = elo.gym.OptionsWrapper(Telling(options), options)
    wrapper.reset(seed=1)
    for option in (-1, 3):
        with pytest.raises(IndexError, match=f"option {option} of a set of 3"):
            wrapper.step(option)
    with pytest.raises(TypeError):
        wrapper.step(1.5)
    wrapper = elo.gym.OptionsWrapper(Telling(options), options, primitive=True)
    wrapper.reset(seed=1)
    with pytest.raises(ValueError, match=r"expected an action of shape \(10,\), got \(4,\)"):
        wrapper.step(np.ones(4, np.float32))


def test_a_column_of_a_plan_is_an_action() -> None:
    plan = np.linspace(-1.0, 1.0, 12).reshape(6, 2)
    one, other = elo.gym.make(RAPIER), elo.gym.make(RAPIER)
    for environment in (one, other):
        environment.reset(seed=1)
    assert np.array_equal(one.step(plan.astype(np.float32)[:, 1])[0], other.step(plan[:, 1].copy())[0])


def test_options_of_a_reset_that_are_not_known_are_refused() -> None:
    environment = elo.gym.make(RAPIER)
    with pytest.raises(ValueError, match="reset has no option `tasks`; expected one of task, state"):
        environment.reset(options={"tasks": {"electricity_cost": 0.0}})


def test_a_robot_of_ones_own_is_read_from_its_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    alive = {"min_height": 0.55, "max_pitch": 0.8}
    own = {"name": "hopper", "mjcf": "hopper.xml", "torso": "torso", "feet": ["foot"], "alive": alive}
    table = {"kind": "rapier", "own_robot": own}
    monkeypatch.chdir(REPOSITORY / "examples")
    environment = elo.gym.make(table)
    environment.reset(seed=1)
    assert environment.step(environment.action_space.sample())[0].shape == environment.observation_space.shape
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="cannot read `hopper.xml`"):
        elo.gym.make(table)


def pickled(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


@pytest.mark.parametrize("copied", [pickled, copy.deepcopy], ids=["pickle", "deepcopy"])
def test_copies_do_what_the_original_does(closed_loop_set: Path, copied: Any) -> None:
    options = elo.load(closed_loop_set)
    again, observation = copied(options), np.linspace(-1.0, 1.0, 26)
    assert again.manifest == options.manifest
    assert np.array_equal(again.act(1, observation, 2, 3), options.act(1, observation, 2, 3))

    environment = elo.gym.Environment(RAPIER, {"electricity_cost": -1.0})
    environment.reset(seed=5)
    again, action = copied(environment), np.full(6, 0.5, np.float32)
    with pytest.raises(RuntimeError, match="call reset first"):
        again.step(action)
    # Its generator goes on where the original's does.
    assert np.array_equal(again.reset()[0], environment.reset()[0])
    (first, gained, *_), (second, earned, *_) = again.step(action), environment.step(action)
    assert np.array_equal(first, second) and gained == earned

    wrapper = over(closed_loop_set)
    assert played(copied(wrapper), 1) == played(wrapper, 1)


def test_a_pickled_set_needs_no_folder(option_set: Path, tmp_path: Path) -> None:
    for file in option_set.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    data = pickle.dumps(elo.load(tmp_path))
    for file in tmp_path.iterdir():
        file.unlink()
    assert len(pickle.loads(data)) == 3


def wrapped(options: elo.OptionSet) -> elo.gym.OptionsWrapper:
    return elo.gym.OptionsWrapper(elo.gym.make(RAPIER), options)


def test_sets_are_sent_to_environments_in_other_processes(closed_loop_set: Path) -> None:
    made = [functools.partial(wrapped, elo.load(closed_loop_set))] * 2
    here = gymnasium.vector.SyncVectorEnv(made)
    there = gymnasium.vector.AsyncVectorEnv(made, context="spawn")
    try:
        assert np.array_equal(here.reset(seed=3)[0], there.reset(seed=3)[0])
        for option in (0, 1, 2):
            (first, gained, *_), (second, earned, *_) = here.step([option] * 2), there.step([option] * 2)
            assert np.array_equal(first, second) and np.array_equal(gained, earned)
    finally:
        there.close()


class Learner:
    """Stands in for Stable-Baselines3's PPO: notes the discount that it is given, and learns nothing from episodes of one step."""

    discounts: ClassVar[list[float]] = []

    def __init__(self, _policy: str, environment: Any, gamma: float, **_others: Any) -> None:
        self.discounts.append(gamma)
        assert environment.action_space is not None

    def learn(self, limit: int, callback: Any) -> None:
        callback.locals = {"infos": [{}], "rewards": np.ones(1), "dones": np.ones(1, bool)}
        steps = 1
        while callback._on_step():
            steps += 1
        assert steps == limit


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], Any]:
    """Runs the example of PPO over options on a set, with something in the place of the packages that it needs."""
    for name in ("matplotlib", "matplotlib.pyplot", "torch", "stable_baselines3", "stable_baselines3.common"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    monkeypatch.setitem(sys.modules, "stable_baselines3", SimpleNamespace(PPO=Learner))
    callbacks = SimpleNamespace(BaseCallback=type("BaseCallback", (), {}))
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.callbacks", callbacks)
    monkeypatch.setattr(Learner, "discounts", [])

    def run(folder: Path) -> None:
        program = REPOSITORY / "examples" / "python" / "stable_baselines3" / "over_options.py"
        monkeypatch.setattr(sys, "argv", [str(program), str(folder), "10", "plot.png"])
        runpy.run_path(str(program), run_name="__main__")

    return run


def test_the_example_refuses_options_that_end_by_chance(example: Callable[[Path], Any], closed_loop_set: Path) -> None:
    """It gives Stable-Baselines3 one discount for all decisions."""
    with pytest.raises(SystemExit, match="option 0 ends by chance; expected options of one fixed length"):
        example(closed_loop_set)
    assert Learner.discounts == []


def test_the_example_discounts_decisions_by_their_length(
    example: Callable[[Path], Any], option_set: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    example(option_set)
    assert Learner.discounts == [0.98, pytest.approx(0.98**8)]
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["torques", "options"]
