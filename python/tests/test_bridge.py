"""What environments in Python are told and what is taken from them, one environment at a time."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import elo.conformance
import elo.gym
import gymnasium
import numpy as np
import pytest
from conftest import ENVIRONMENTS
from elo import bodies

FORCE = np.zeros(1, np.float32)


@pytest.fixture(autouse=True)
def _environments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ENVIRONMENTS))


def parameter(name: str, binding: str) -> dict[str, Any]:
    return {"name": name, "default": 1.0, "low": -2.0, "high": 2.0, "binding": binding}


def environment(target: str, *parameters: dict[str, Any], **fields: Any) -> elo.gym.Environment:
    table = {"kind": "python", "target": target, "reward_floor": -10.0, "state": {}, "task_parameters": list(parameters)}
    return elo.gym.Environment({**table, **fields})


def wrong(how: str, **fields: Any) -> elo.gym.Environment:
    return environment("toys:Wrong", kwargs={"how": how, "at": 0.0}, **fields)


def test_parameters_that_go_with_a_reset_reach_an_episode_that_begins_in_a_state() -> None:
    env = environment("toys:Asked", parameter("goal", "option"))
    env.reset(seed=1)
    state = env.state()
    place = state["positions"][0]
    for goal in (-1.0, 0.5, 1.0):
        env.reset(options={"state": state, "task": {"goal": goal}})
        assert env.step(FORCE)[1] == pytest.approx(-abs(goal - place))


def test_both_kinds_of_parameters_reach_an_episode_that_begins_in_a_state() -> None:
    env = environment("toys:Asked", parameter("goal", "option"), parameter("weight", "constructor"))
    env.reset(seed=1)
    state = env.state()
    env.reset(options={"state": state, "task": {"goal": -1.0, "weight": 2.0}})
    observation, reward, *_ = env.step(np.ones(1, np.float32))
    assert reward == pytest.approx(-abs(-1.0 - observation[0]))
    assert observation[1] == pytest.approx(0.05 / 2.0)


def test_an_environment_that_cannot_be_made_leaves_the_old_one() -> None:
    env = environment("toys:Fragile", parameter("weight", "constructor"))
    first, _ = env.reset(seed=1)
    for _ in range(2):
        with pytest.raises(ValueError, match="the mass is too heavy"):
            env.reset(seed=1, options={"task": {"weight": 1.75}})
    assert np.array_equal(env.reset(seed=1)[0], first)
    env.reset(seed=1, options={"task": {"weight": 0.5}})
    assert env.step(np.ones(1, np.float32))[0][1] == pytest.approx(0.05 / 0.5)


def noted(diary: Path, **fields: Any) -> dict[str, Any]:
    kwargs = {"diary": str(diary)}
    return {"kind": "python", "target": "toys:Noted", "kwargs": kwargs, "reward_floor": -10.0, "state": {}, **fields}


def test_what_is_closed_closes_the_environment_and_can_be_closed_again(tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    with elo.gym.make(noted(diary)) as env:
        env.reset(seed=1)
        # One to find out what it is, and the one that is used.
        assert diary.read_text().split() == ["opened", "closed", "opened"]
    for _ in range(2):
        assert diary.read_text().split() == ["opened", "closed"] * 2
        env.close()
    env = env.unwrapped
    for use in (env.reset, env.state, lambda: env.step(FORCE)):
        with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="closed; make another one"):
            use()
    again = pickle.loads(pickle.dumps(env))
    again.reset(seed=1)
    again.step(FORCE)


def test_every_environment_is_closed_once(tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    table = noted(diary, task_parameters=[parameter("weight", "constructor")])
    env = elo.gym.Environment(table)
    for weight in (1.0, 1.5, 2.0):
        env.reset(seed=1, options={"task": {"weight": weight}})
        env.step(FORCE)
    del env
    lines = diary.read_text().split()
    assert (lines.count("opened"), lines.count("closed")) == (4, 4)
    assert elo.conformance.simulator(noted(diary)) == []
    lines = diary.read_text().split()
    assert lines.count("opened") == lines.count("closed") > 20


def test_environments_are_closed_when_the_interpreter_ends(tmp_path: Path) -> None:
    program = f"import elo.gym\nenv = elo.gym.make({noted(tmp_path / 'diary')})\nenv.reset(seed=1)\nprint('the end')"
    path = os.pathsep.join([str(ENVIRONMENTS), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", program]
    ran = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
    assert (ran.stdout, ran.stderr) == ("the end\n", "")
    assert (tmp_path / "diary").read_text().split() == ["opened", "closed"] * 2


def test_a_gymnasium_id_with_constructor_parameters_begins_in_states() -> None:
    env = environment("toys:Mass-v0", parameter("weight", "constructor"))
    env.reset(seed=1)
    state = env.state()
    for weight in (1.0, 0.5, 2.0):
        env.reset(options={"state": state, "task": {"weight": weight}})
        # Longer than the time limit that the id brings.
        assert [env.step(np.ones(1, np.float32))[0][1] for _ in range(8)][0] == pytest.approx(0.05 / weight)
    with pytest.raises(ValueError, match="`kwargs` of `toys:Mass-v0` name `max_episode_steps`, which elo gives"):
        environment("toys:Mass-v0", kwargs={"max_episode_steps": 3})


def test_a_state_that_is_one_array_is_given_back_as_it_was() -> None:
    env = environment("toys:Row")
    seen, _ = env.reset(seed=1)
    state = env.state()
    env.step(np.ones(1, np.float32))
    assert np.array_equal(env.reset(options={"state": state})[0], seen)
    assert (state["positions"], state["velocities"]) == (pytest.approx(seen.tolist()), [])
    # A fresh one has to find out what its state is like.
    assert np.array_equal(environment("toys:Row").reset(options={"state": state})[0], seen)
    with pytest.raises(ValueError, match="a state of another robot"):
        env.reset(options={"state": {**state, "velocities": [1.0]}})
    assert elo.conformance.simulator({"kind": "python", "target": "toys:Row", "reward_floor": -10.0, "state": {}}) == []


def test_actions_lie_in_spaces_whose_bounds_are_rounded() -> None:
    env = environment("toys:Strict")
    env.reset(seed=1)
    for force in (-1.0, -0.1, 0.1, 1.0):
        env.step(np.array([force], np.float32))
    assert elo.conformance.simulator({"kind": "python", "target": "toys:Strict", "reward_floor": -10.0, "state": {}}) == []


def test_states_are_seen_through_wrappers() -> None:
    env = environment("toys:doubled")
    seen, _ = env.reset(seed=1)
    state = env.state()
    assert seen[0] == pytest.approx(2.0 * state["positions"][0])
    assert np.array_equal(env.reset(options={"state": state})[0], seen)
    with pytest.raises(ValueError, match="Cut changes observations and has no method `observation`"):
        environment("toys:cut")
    with pytest.raises(ValueError, match="Mass has no methods `get_state` and `put_state`"):
        environment("toys:Mass", state={"set": "put_state"})


def test_numbers_that_are_not_finite_are_refused_from_the_first() -> None:
    with pytest.raises(ValueError, match="not finite"):
        wrong("nan at reset").reset(seed=1)
    env = wrong("nan when set")
    env.reset(seed=1)
    with pytest.raises(ValueError, match="not finite"):
        env.reset(options={"state": env.state()})
    # It can be used again.
    env.reset(seed=1)
    env.step(FORCE)


def test_a_term_that_is_no_number_is_named() -> None:
    env = wrong("no term", reward_terms=[{"name": "nearness", "weight": 1.0}, {"name": "effort", "weight": 1.0}])
    env.reset(seed=1)
    with pytest.raises(RuntimeError, match="the reward term `effort` None, expected a number"):
        env.step(FORCE)


TERMS = [{"name": "nearness", "weight": 1.0}, {"name": "effort", "weight": 1.0}]


@pytest.mark.parametrize(
    ("how", "terms", "said"),
    [
        ("nan term", TERMS, "the reward term `effort` nan, which is not finite"),
        ("nan reward", [], "the reward nan, which is not finite"),
        ("complex reward", [], r"the reward .*1\+0j.*, expected a number"),
        ("no info", TERMS, "`info` None, expected a mapping"),
        ("list of terms", TERMS, r"`info\[\"reward_terms\"\]` \[1.0, 2.0\], expected a mapping"),
        ("unsaid end", [], "`terminated` None, expected True or False"),
        ("end in words", [], "`truncated` 'no', expected True or False"),
    ],
)
def test_what_a_step_gives_is_checked_and_named(how: str, terms: list[dict[str, Any]], said: str) -> None:
    env = wrong(how, reward_terms=terms)
    env.reset(seed=1)
    with pytest.raises(RuntimeError, match=said):
        env.step(FORCE)


def test_numbers_of_numpys_are_numbers() -> None:
    env = environment("toys:Single", reward_terms=TERMS)
    assert env.control_step == pytest.approx(0.05)
    env.reset(seed=1)
    _, reward, terminated, truncated, info = env.step(FORCE)
    assert (terminated, truncated) == (True, False)
    assert reward == pytest.approx(sum(info["reward_terms"].values())) and reward < -0.5
    env = environment("toys:Single")
    env.reset(seed=1)
    assert env.step(FORCE)[1] == pytest.approx(reward)


@pytest.mark.parametrize(("how", "said"), [("dict", "FlattenObservation"), ("discrete", "ActionWrapper")])
def test_spaces_that_are_no_boxes_are_told_how_to_become_one(how: str, said: str) -> None:
    with pytest.raises(ValueError, match=rf"expected a Box; wrap the environment by .*{said}"):
        wrong(how)


def told(folder: Path, target: str, role: str = "environment") -> str:
    """What a fresh process says that results of `target` depend on."""
    robot = {"name": "dot", "mjcf": "", "substeps": 1, "torso": 0, "bodies": [], "joints": [], "positions": 0, "velocities": 0}
    table = {"target": target, "kwargs": {}, "task_parameters": [], "reward_terms": [], "robot": robot}
    program = f"from elo._bridge.{role} import Bridge; print(Bridge({json.dumps(json.dumps(table))}).describe())"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ENVIRONMENTS), os.environ.get("PYTHONPATH", "")])}
    ran = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_results_depend_on_factories_classes_and_wrappers(tmp_path: Path) -> None:
    texts = {
        "base": "from toys import Mass\nclass Base(Mass): pass\n",
        "inner": "from base import Base\nclass Inner(Base): pass\n",
        "wrapper": "import gymnasium\nclass Wrapper(gymnasium.Wrapper): pass\n",
        "factory": "import gymnasium\nfrom inner import Inner\nfrom wrapper import Wrapper\n"
        "def make(): return gymnasium.wrappers.TimeLimit(Wrapper(Inner()), 9)\n",
        "named": "from factory import make\n",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
    before = told(tmp_path, "named:make")
    assert before == told(tmp_path, "named:make")
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text + "# changed\n")
        assert told(tmp_path, "named:make") != before, name
        (tmp_path / f"{name}.py").write_text(text)
    assert told(tmp_path, "named:make") == before
    assert [part.split()[0] for part in json.loads(told(tmp_path, "toys:Mass"))["versions"].split(", ")] == [
        "python",
        "numpy",
        "gymnasium",
        "toys",
    ]


def test_results_depend_on_the_factory_of_a_body(tmp_path: Path) -> None:
    methods = "set_dynamics = restore = advance = read = lambda *_: None"
    texts = {"shape": f"class Shape:\n    {methods}\n", "maker": "import shape\ndef make(robot): return shape.Shape()\n"}
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
    before = told(tmp_path, "maker:make", "body")
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text + "# changed\n")
        assert told(tmp_path, "maker:make", "body") != before, name
        (tmp_path / f"{name}.py").write_text(text)


def test_a_reading_is_written_into() -> None:
    joint = bodies.Joint("hip", 7, 6)
    reading = bodies.Reading(bodies.Robot("dot", "", 1, 0, ["torso", "leg"], [joint], 8, 7))
    assert reading.all.shape == (3 * 2 + 4 * 2 + 3 + 1 + 1 + 2 + 8 + 7,)
    reading.body_rotations[1] = 1.0, 0.0, 0.0, 0.0
    reading.positions[:] = np.arange(8)
    assert reading.all.tolist() == [0.0] * 10 + [1.0] + [0.0] * 10 + list(range(8)) + [0.0] * 7
    for name in ("body_positions", "torso_velocity", "on_floor", "velocities"):
        with pytest.raises(AttributeError):
            setattr(reading, name, np.zeros_like(getattr(reading, name)))
