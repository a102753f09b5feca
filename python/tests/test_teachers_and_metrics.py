"""Teachers and metrics in Python: those that work, and those that go wrong."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import elo.conformance
import numpy as np
import pytest
from conftest import ENVIRONMENTS, Discover
from test_simulators import same

MASS = 'target = "toys:Mass"\nreward_floor = -10.0'
CONTROLLER = 'teacher={kind="python",target="toys:controller"}'
TABLE = {"kind": "python", "target": "toys:Mass", "reward_floor": -10.0, "state": {}}


def metric(**kwargs: object) -> str:
    table = ",".join(f"{key}={json.dumps(value)}" for key, value in kwargs.items())
    return f'metrics=[{{kind="maximum_mean"}},{{kind="python",target="toys:cvar",kwargs={{{table}}}}}]'


@pytest.fixture(autouse=True)
def _environments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ENVIRONMENTS))


def test_the_suites_pass_what_is_right_and_find_what_is_wrong() -> None:
    assert elo.conformance.teacher({"kind": "python", "target": "toys:controller"}, TABLE) == []
    assert elo.conformance.metric({"kind": "python", "target": "toys:cvar"}) == []
    spoilt = {"kind": "python", "target": "toys:cvar", "kwargs": {"how": "nan"}}
    assert elo.conformance.metric(spoilt) == ["scores_are_finite"]
    with pytest.raises(ValueError, match="finds no module `nowhere`"):
        elo.conformance.metric({"kind": "python", "target": "nowhere:score"})


def test_a_teacher_and_a_metric_are_used_from_end_to_end(discover: Discover, tmp_path: Path) -> None:
    ran = discover(MASS, "--set", CONTROLLER, "--set", metric(share=0.5), "--workers", "1")
    assert ran.returncode == 0, ran.stderr
    results = tmp_path / "run" / "results"
    # A teacher from elsewhere was never untrained.
    report = json.loads((results / "report.json").read_text())
    assert [row["name"] for row in report["baselines"]] == [
        "random K-subsets",
        "random torque",
        "zero torque",
        "teachers",
    ]
    # The controller reaches the goal and stays: at most its way there is lost.
    assert report["candidates"]["teacher_return"] > -20.0 * 1.5
    # The scores are those of the function, by the returns that the run stored.
    label = "cvar(share=0.5)"
    assert [row["metric"] for row in report["sets"]] == ["maximum_mean", label]
    returns = np.load(results / "select_terms.npy")[..., 0]
    normal = (returns - report["scale"]["offset"]) / report["scale"]["scale"]
    worst = np.sort(normal, axis=1)[:, :3].mean(axis=1)
    with open(results / "candidates.csv", newline="") as file:
        scores = [float(row[label]) for row in csv.DictReader(file)]
    assert np.allclose(scores, worst) and len(set(scores)) > 1
    assert report["sets"][1]["score"]["low"] <= report["sets"][1]["score"]["estimate"] <= report["sets"][1]["score"]["high"]
    # However many work, the bytes are the same.
    assert discover(MASS, "--set", CONTROLLER, "--set", metric(share=0.5), "--workers", "2", out="two").returncode == 0
    assert same(results, tmp_path / "two" / "results")
    # Another share is another metric, and measures nothing again.
    again = discover(MASS, "--set", CONTROLLER, "--set", metric(share=0.2))
    assert again.returncode == 0 and "cvar(share=0.2)" in again.stdout, again.stderr


@pytest.mark.parametrize("engine", ["rapier", "mujoco"])
def test_a_teacher_from_a_file_on_our_own_robots(discover: Discover, tmp_path: Path, engine: str) -> None:
    weights = tmp_path / "weights.npy"
    np.save(weights, np.random.default_rng(1).standard_normal((6, 26)).astype(np.float32) * 0.1)
    robot = f'simulator={{kind="{engine}",robot="half-cheetah"}}'
    teacher = 'teacher={kind="python",target="toys:replayer",files={weights="weights.npy"}}'
    sizes = ["--set", "discover.steps=5", "--set", "initial_states.max_random_steps=0"]
    ran = discover(MASS, "--set", robot, "--set", teacher, *sizes)
    assert ran.returncode == 0, ran.stderr
    before = (tmp_path / "run" / "results" / "select_terms.npy").read_bytes()
    # Other weights are another teacher, though the path is the same.
    np.save(weights, np.zeros((6, 26), np.float32))
    assert discover(MASS, "--set", robot, "--set", teacher, *sizes).returncode == 0
    assert (tmp_path / "run" / "results" / "select_terms.npy").read_bytes() != before


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ('teacher={kind="python",target="nowhere:load"}', "`teacher`: `nowhere:load`: "),
        ('teacher={kind="python",target="toys:controller",files={weights="gone.npz"}}', "`teacher.files.weights`: there is no file"),
        ('teacher={kind="python",target="toys:controller",kwargs={seed=1}}', "`seed` is an argument that the program gives"),
        ('metrics=[{kind="python",target="toys"}]', "not `module:callable`"),
        ('metrics=[{kind="python",target="toys:nothing"}]', "has no `nothing`"),
        ('metrics=[{kind="python",target="sys:path"}]', "expected something that can be called"),
    ],
)
def test_what_cannot_be_used_is_refused(discover: Discover, tmp_path: Path, setting: str, said: str) -> None:
    ran = discover(MASS, "--set", setting)
    assert ran.returncode == 2 and said in ran.stderr, ran.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("no policy", "expected a policy to call"),
        ("two actions", "float64 of shape (2,), expected 1 numbers"),
        ("text", "expected 1 numbers"),
        ("nan", "an action that is not finite"),
        ("raises", "the teacher has gone home"),
    ],
)
def test_a_teacher_that_goes_wrong_is_told(discover: Discover, how: str, said: str) -> None:
    teacher = f'teacher={{kind="python",target="toys:controller",kwargs={{how="{how}"}}}}'
    ran = discover(MASS, "--set", teacher)
    assert ran.returncode == 1 and said in ran.stderr, ran.stderr


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("raises", "nothing is good enough"),
        ("one number", "expected one number a row"),
        ("text", "expected one number a row"),
    ],
)
def test_a_metric_that_goes_wrong_is_told_before_any_work(discover: Discover, tmp_path: Path, how: str, said: str) -> None:
    ran = discover(MASS, "--set", CONTROLLER, "--set", metric(how=how))
    assert ran.returncode == 2 and said in ran.stderr, ran.stderr
    assert not (tmp_path / "run").exists()


def test_an_argument_that_a_metric_does_not_take_is_told_before_any_work(discover: Discover) -> None:
    ran = discover(MASS, "--set", CONTROLLER, "--set", metric(shar=0.5))
    assert ran.returncode == 2 and "unexpected keyword argument 'shar'" in ran.stderr, ran.stderr


def test_scores_that_are_no_numbers_are_told(discover: Discover) -> None:
    ran = discover(MASS, "--set", CONTROLLER, "--set", metric(how="nan"))
    assert ran.returncode == 1 and "no candidate can be chosen by cvar" in ran.stderr, ran.stderr


def test_workers_that_are_killed_change_no_byte(elo_program: Path, discover: Discover, tmp_path: Path) -> None:
    sizes = ["--set", "discover.candidates=100", "--set", "discover.contexts=1500", "--workers", "2"]
    assert discover(MASS, "--set", CONTROLLER, *sizes, out="undisturbed").returncode == 0
    command = [elo_program, "discover", tmp_path / "run.toml", "--out", tmp_path / "run", "--set", CONTROLLER, *sizes]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        killed = 0
        while process.poll() is None:
            time.sleep(1.0)
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            for child in children.read_text().split()[:1] if process.poll() is None else []:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(child), signal.SIGKILL)
                    killed += 1
        told = process.stderr.read() if process.stderr else ""
    assert process.returncode == 0 and killed >= 2, (killed, told)
    assert same(tmp_path / "run" / "results", tmp_path / "undisturbed" / "results")
