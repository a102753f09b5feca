"""Environments in Python as simulators of the program `elo`: those that work, and those that go wrong."""

from __future__ import annotations

import csv
import json
import os
import re
from pathlib import Path

import elo.conformance
import pytest
from conftest import Discover

MASS = """
target = "toys:Mass"
[[simulator.reward_terms]]
name = "nearness"
weight = 1.0
[[simulator.reward_terms]]
name = "effort"
parameter = "effort_cost"
[[simulator.task_parameters]]
name = "effort_cost"
default = -0.1
low = -1.0
high = 0.0
binding = "price"
[[simulator.task_parameters]]
name = "weight"
default = 1.0
low = 0.5
high = 2.0
binding = "constructor"
[[simulator.task_parameters]]
name = "goal"
default = 1.0
low = -2.0
high = 2.0
binding = "attribute"
"""
TASKS = "tasks={effort_cost={low=-0.5,high=-0.1},weight={low=0.5,high=2.0},goal={low=0.5,high=1.5}}"


def wrong(how: str, marker: Path | None = None, at: float = 0.0) -> str:
    kwargs = {"how": how, "at": at, "marker": str(marker or "")}
    table = ", ".join(f"{key} = {json.dumps(value)}" for key, value in kwargs.items())
    return f'target = "toys:Wrong"\nkwargs = {{ {table} }}'


TAUGHT = ["--set", 'teacher={kind="python",target="toys:controller"}']
"""No training, in which a fault would count as a failed episode."""


def failures(out: Path) -> list[dict[str, str]]:
    with open(out / "results" / "failures.csv", newline="") as file:
        return list(csv.DictReader(file))


def same(one: Path, other: Path) -> bool:
    files = sorted(path.relative_to(one) for path in one.rglob("*") if path.is_file())
    there = sorted(path.relative_to(other) for path in other.rglob("*") if path.is_file())
    return files == there and all((one / path).read_bytes() == (other / path).read_bytes() for path in files)


def test_a_gymnasium_id(discover: Discover, tmp_path: Path) -> None:
    ran = discover('target = "Pendulum-v1"')
    assert ran.returncode == 0, ran.stderr
    assert "Pendulum-v1 in python:Pendulum-v1" in ran.stdout and failures(tmp_path / "run") == []


def test_a_file_of_ones_own_with_tasks_and_terms(discover: Discover, tmp_path: Path) -> None:
    ran = discover(MASS, "--set", TASKS, "--workers", "1")
    assert ran.returncode == 0, ran.stderr
    report = json.loads((tmp_path / "run" / "results" / "report.json").read_text())
    assert report["robot"] == "toys:Mass" and "toys" in report["engine"]["version"]
    manifest = json.loads(next(tmp_path.glob("run/results/option_sets/*/manifest.json")).read_text())
    assert [term["name"] for term in manifest["spec"]["reward_terms"]] == ["nearness", "effort"]
    assert manifest["spec"]["control_step"] == 0.05
    assert discover(MASS, "--set", TASKS, "--workers", "2", out="two").returncode == 0
    assert same(tmp_path / "run" / "results", tmp_path / "two" / "results")


@pytest.mark.parametrize("state", [True, False])
def test_the_conformance_suite(state: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "environments"))
    config = {"kind": "python", "target": "toys:Mass", "reward_floor": -10.0}
    if state:
        config["state"] = {}
    assert elo.conformance.simulator(config) == []


@pytest.mark.parametrize("robot", ["ant", "half-cheetah", "walker2d"])
def test_the_conformance_suite_of_mujocos_bodies(robot: str) -> None:
    assert elo.conformance.simulator({"kind": "python_body", "robot": robot}) == []


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"target": "elo.bodies:Reading"}, "has no method `set_dynamics`"),
        ({"kwargs": {"version": "2.0.0"}}, "expected 2.0.0: pip install mujoco==2.0.0"),
        ({"robot": "unicorn"}, "no robot"),
        ({"target": "elo.bodies"}, "expected `module:callable`"),
    ],
)
def test_what_is_no_body_is_refused(fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        elo.conformance.simulator({"kind": "python_body", "robot": "ant", **fields})


def test_conformance_finds_what_is_not_repeatable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "environments"))
    config = {"kind": "python", "target": "toys:Wrong", "kwargs": {"how": "hidden counter"}}
    assert "a_used_object_repeats" in elo.conformance.simulator(config)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("shows its process", r"step 1: observation\[1\]: expected -?\d\.\d+, got \d{2,}"),
        ("pays a little more", r"step 1: reward term `reward`: expected -\d\.\d+, got -\d\.\d+"),
        ("ends", r"step 1: terminated: expected 0\.0, got 1\.0"),
        ("sees more", "numbers in observation and reward: expected 3, got 4"),
        ("is not made", "in the other process: expected an episode, got exit code 1: .*the port is taken"),
        ("exits", "in the other process: expected an episode, got exit code 3$"),
        ("aborts", r"in the other process: expected an episode, got signal 6 \(SIGABRT\)"),
    ],
)
def test_conformance_finds_what_other_processes_do_otherwise(
    how: str, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "environments"))
    config = {"kind": "python", "target": "toys:Away", "kwargs": {"home": os.getpid(), "how": how}, "reward_floor": -10.0}
    assert elo.conformance.simulator(config) == ["another_process_repeats"]
    report = capsys.readouterr().out
    assert re.search(f"^  FAILED  another_process_repeats: {said}", report, re.MULTILINE), report
    assert re.search(r"toys:Away.*: \d+ passed, 1 failed, \d+ skipped$", report, re.MULTILINE), report


def test_conformance_tells_of_the_rule_about_other_processes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "environments"))
    config = {"kind": "python", "target": "toys:Mass", "reward_floor": -10.0}
    _, others = elo._elo.conformance("simulator", json.dumps(config), json.dumps({"kind": "point_mass"}))
    assert elo.conformance.simulator(config) == []
    head, *lines = capsys.readouterr().out.rstrip("\n").split("\n")
    passed = int(re.search(r": (\d+) passed, 0 failed", others.split("\n")[0])[1])
    assert lines == others.split("\n")[1:]
    assert head == others.split("\n")[0].replace(f"{passed} passed", f"{passed + 1} passed")
    # One that fails here fails there, and is told once.
    raising = {"kind": "python", "target": "toys:Wrong", "kwargs": {"how": "raises", "at": 0.0}}
    assert "another_process_repeats" in elo.conformance.simulator(raising)
    assert "in this process: expected an episode, got RuntimeError: the motor is on fire" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("simulator", "said"),
    [
        ('target = "nowhere:Env"', "finds no module `nowhere`"),
        ('target = "toys:Nothing"', "module `toys` has no `Nothing`"),
        ('target = "toys"', "neither a Gymnasium id"),
        ('target = "NoSuch-v0"', "NoSuch"),
        (wrong("dict"), "expected a Box"),
        (wrong("discrete"), "expected a Box"),
        ('target = "toys:Mass"\nkwargs = { wait = 1 }', "unexpected keyword argument 'wait'"),
        ('target = "toys:Mass"\nreward_terms = [{ name = "nearness" }]', "either `weight` or `parameter`"),
    ],
)
def test_what_cannot_be_a_simulator_is_refused(
    discover: Discover, tmp_path: Path, simulator: str, said: str
) -> None:
    ran = discover(simulator)
    assert ran.returncode == 2 and said in ran.stderr, ran.stderr
    assert not (tmp_path / "run").exists()


def test_no_python_is_told(discover: Discover, tmp_path: Path) -> None:
    for python in ["/nonexistent/python", "/usr/bin/env"]:
        ran = discover(MASS, "--set", f'workers.python="{python}"')
        assert ran.returncode == 2 and "pip install './python[gym]'" in ran.stderr, ran.stderr


def test_raising_once_in_training_ends_nothing(discover: Discover, tmp_path: Path) -> None:
    """The episode of training is counted as failed."""
    marker = tmp_path / "marker"
    ran = discover(wrong("raises", marker, 0.52))
    assert ran.returncode == 0 and marker.exists(), ran.stderr


def test_raising_once_in_a_rollout_changes_no_byte(discover: Discover, tmp_path: Path) -> None:
    """It is tried again in a new environment, with the same seeds. No training comes before it here."""
    marker = tmp_path / "marker"
    ran = discover(wrong("raises", marker, 0.52), *TAUGHT)
    assert ran.returncode == 0 and marker.exists() and failures(tmp_path / "run") == [], ran.stderr
    assert discover(wrong("raises", marker, 0.52), *TAUGHT, out="undisturbed").returncode == 0
    assert same(tmp_path / "run" / "results", tmp_path / "undisturbed" / "results")
    # What raises each time is a recorded failure, with its traceback.
    assert discover(wrong("raises", at=0.9), *TAUGHT, out="always").returncode == 0
    lost = failures(tmp_path / "always")
    assert lost and all(re.search(r'toys.py", line \d+, in step .*: the motor is on fire', row["reason"]) for row in lost), lost
    assert not any("_bridge" in row["reason"] for row in lost), lost


def test_a_floor_above_the_rewards_is_told(discover: Discover) -> None:
    ran = discover(MASS, "--set", "simulator.reward_floor=5")
    assert ran.returncode == 2 and "less than `reward_floor`, 5;" in ran.stderr, ran.stderr


def test_episodes_that_are_others_in_another_process_are_told(discover: Discover) -> None:
    ran = discover('target = "habits:Homely"\nreward_floor = -10.0', *TAUGHT)
    said = "warning: `simulator`: the same seed and actions gave another episode in another process, from step 1 on"
    assert ran.returncode == 0 and said in ran.stderr, ran.stderr
    assert "warning" not in discover('target = "toys:Mass"\nreward_floor = -10.0', *TAUGHT, out="sound").stderr


def test_episodes_that_do_not_repeat_are_told(discover: Discover) -> None:
    ran = discover(wrong("hidden counter"))
    assert ran.returncode == 0, ran.stderr
    assert "warning: `simulator`: the same seed and actions gave another episode, from step" in ran.stderr, ran.stderr
    assert "gave another episode" not in discover(MASS, out="sound").stderr


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("exits", "ended with exit code 0"),
        ("aborts", "ended with signal 6 (SIGABRT)"),
        ("segfaults", "ended with signal 11 (SIGSEGV)"),
        ("hangs", "the environment did not come back within 1 s"),
        ("sleeps", "the environment did not come back within 1 s"),
    ],
)
def test_a_fault_that_passes_changes_no_byte(discover: Discover, tmp_path: Path, how: str, said: str) -> None:
    """The environment goes wrong once, in the middle of the run; its unit is done again with the same seeds."""
    marker = tmp_path / "marker"
    # The mass gets so far only in rollouts of trained options or teachers.
    limits = "step_seconds = 1.0"
    ran = discover(wrong(how, marker, 0.52), workers=limits)
    assert ran.returncode == 0, ran.stderr
    assert marker.exists()
    again = discover(wrong(how, marker, 0.52), workers=limits, out="undisturbed")
    assert again.returncode == 0, again.stderr
    lost = [line for line in ran.stderr.splitlines() if line.startswith("elo: the python worker, unit ")]
    assert len(lost) == 1 and said in ran.stderr, ran.stderr
    # Where its own code had the time to say so, the line in it is told.
    assert how == "exits" or re.search(r'toys.py", line \d+ in step', ran.stderr), ran.stderr
    assert "worker" not in again.stderr, again.stderr
    assert same(tmp_path / "run" / "results", tmp_path / "undisturbed" / "results")


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("nan", "not finite"),
        ("shape", "an observation of shape (3,), its space says (2,)"),
        ("text", "expected numbers"),
        ("four", "Gymnasium's interface"),
        ("no reward", "the reward None"),
        ("raises", "the motor is on fire"),
    ],
)
def test_a_fault_that_stays_is_told(discover: Discover, tmp_path: Path, how: str, said: str) -> None:
    ran = discover(wrong(how))
    assert ran.returncode == 2 and said in ran.stderr and "a short trial before any work" in ran.stderr, ran.stderr
    assert not (tmp_path / "run").exists()
    assert discover(wrong(how), "--plan").returncode == 2
