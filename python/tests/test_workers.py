"""The interpreters in which environments run: where they find modules, what watches them, and what is told when they are lost."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import Discover
from test_simulators import MASS, TAUGHT, failures, same, wrong


def test_the_working_directory_shadows_no_module(discover: Discover, tmp_path: Path) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    for name in ("gymnasium", "elo", "numpy", "runpy", "toys"):
        (folder / f"{name}.py").write_text("raise RuntimeError('this is the wrong module')\n")
    ran = discover(MASS, cwd=folder)
    assert ran.returncode == 0, ran.stderr


def test_what_takes_long_to_import_is_no_step_that_takes_long(discover: Discover) -> None:
    ran = discover('target = "slow:Mass"', workers="step_seconds = 1.0")
    assert ran.returncode == 0 and "did not come back" not in ran.stderr, ran.stderr


def test_what_takes_long_to_be_made_anew_is_no_reset_that_takes_long(discover: Discover, tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    weight = 'name = "weight"\ndefault = 1.0\nlow = 0.5\nhigh = 2.0\nbinding = "constructor"'
    simulator = f'target = "toys:Heavy"\nkwargs = {{ marker = "{marker}" }}\n[[simulator.task_parameters]]\n{weight}'
    ran = discover(simulator, *TAUGHT, "--set", "tasks={weight={low=0.5,high=2.0}}", workers="step_seconds = 1.0")
    assert ran.returncode == 0 and marker.exists() and "did not come back" not in ran.stderr, ran.stderr


def test_reading_a_state_is_watched(discover: Discover) -> None:
    simulator = wrong("sleeps when asked") + "\nstate = {}"
    ran = discover(simulator, "--set", "workers.silence_seconds=20", workers="step_seconds = 0.5")
    assert ran.returncode == 1 and "did not come back within 0.5 s" in ran.stderr, ran.stderr


def test_a_slow_environment_is_not_taken_for_a_silent_one(discover: Discover) -> None:
    """Its starts, an iteration, and the trial after the training: each takes longer than it may be silent."""
    sizes = ["teacher.d0_pool=80", "initial_states.max_random_steps=9", "teacher.steps=512", "teacher.rollout_steps=512"]
    sizes += ["discover.steps=5"]
    settings = [part for size in sizes for part in ("--set", size)]
    ran = discover('target = "habits:Slow"\nreward_floor = -10.0', *settings, workers="silence_seconds = 2.5")
    assert ran.returncode == 0 and "silent" not in ran.stderr, ran.stderr


def test_silence_names_the_field_that_limits_it(discover: Discover) -> None:
    ran = discover(wrong("sleeps", at=-1.0), *TAUGHT, "--set", "discover.candidates=2", workers="silence_seconds = 3.0")
    assert ran.returncode == 2 and "was silent for 3 s (`workers.silence_seconds`) and was killed" in ran.stderr, ran.stderr


def test_environments_are_closed_and_their_processes_end_in_order(discover: Discover, tmp_path: Path) -> None:
    log = tmp_path / "log"
    weight = 'name = "weight"\ndefault = 1.0\nlow = 0.5\nhigh = 2.0\nbinding = "constructor"'
    simulator = f'target = "habits:Logged"\nreward_floor = -10.0\nkwargs = {{ log = "{log}" }}\n[[simulator.task_parameters]]\n{weight}'
    ran = discover(simulator, "--set", "tasks={weight={low=0.5,high=2.0}}")
    assert ran.returncode == 0 and "nobody" not in ran.stderr, ran.stderr
    lines = log.read_text().split("\n")[:-1]
    said = {what: sorted(line.split()[1:] for line in lines if line.startswith(what)) for what in ("made", "closed", "over")}
    assert len(said["made"]) > 6 and said["made"] == said["closed"] == said["over"], lines


@pytest.mark.parametrize(("name", "said"), [("a:b", "has the character in it that separates folders"), ("gone", "there is no ")])
def test_folders_from_which_nothing_can_be_imported_are_told(
    discover: Discover, tmp_path: Path, name: str, said: str
) -> None:
    (tmp_path / "a:b").mkdir()
    ran = discover(MASS, "--set", f'workers.python_path=["{name}"]')
    assert ran.returncode == 2 and "`workers.python_path[0]`: " in ran.stderr and said in ran.stderr, ran.stderr
    assert f"{tmp_path / name}" in ran.stderr and "finds no module" not in ran.stderr, ran.stderr


CRASHES = [("segfaults", "SIGSEGV"), ("aborts", "SIGABRT")]


@pytest.mark.parametrize(("how", "signal"), CRASHES)
def test_a_rollout_that_crashes_each_time_is_recorded(discover: Discover, tmp_path: Path, how: str, signal: str) -> None:
    """Where `at` is below 0, which it is in a sixth of the tasks and not in the teacher's."""
    at = 'name = "at"\ndefault = 100.0\nlow = -20.0\nhigh = 100.0\nbinding = "attribute"'
    sizes = ["--set", "tasks={at={low=-20.0,high=100.0}}", "--set", "initial_states.max_random_steps=0", "--set", "seed=2"]
    simulator = f"{wrong(how)}\n[[simulator.task_parameters]]\n{at}"
    ran = discover(simulator, *TAUGHT, *sizes)
    assert ran.returncode == 0, ran.stderr
    lost = failures(tmp_path / "run")
    assert lost and all(signal in row["reason"] and "toys.py" in row["reason"] for row in lost), lost
    rows = crashing_rows(tmp_path / "run" / "results")
    assert rows and {(row["table"], int(row["row"]), int(row["context"])) for row in lost} == rows
    # The interpreter's words name its threads by address, which are others in each process.
    assert discover(simulator, *TAUGHT, *sizes, "--workers", "1", out="again").returncode == 0
    assert same(tmp_path / "again" / "results", tmp_path / "run" / "results")


def crashing_rows(results: Path) -> set[tuple[str, int, int]]:
    """Every row of every table, in the contexts whose `at` is below 0."""
    rows = set()
    for table, split in [("select", "select"), ("report_options", "report"), ("report_baselines", "report")]:
        with open(results / f"contexts_{split}.csv", newline="") as file:
            crashing = [number for number, context in enumerate(csv.DictReader(file)) if float(context["at"]) < 0.0]
        count = len(np.load(results / f"{table}_ending.npy"))
        rows |= {(table, row, context) for row in range(count) for context in crashing}
    return rows


def test_a_recording_that_crashes_is_taken_again(discover: Discover, tmp_path: Path) -> None:
    """Few starts crash: with this seed none of the rehearsal and of the teacher's trial."""
    sizes = ["--set", "seed=4", "--set", "initial_states.max_random_steps=0", "--set", "discover.candidates=40"]
    ran = discover('target = "toys:Band"', *TAUGHT, *sizes)
    assert ran.returncode == 0, ran.stderr
    taken = [row for row in failures(tmp_path / "run") if row["table"] == "recordings"]
    assert taken and all("SIGABRT" in row["reason"] and "toys.py" in row["reason"] for row in taken), taken
    with open(tmp_path / "run" / "results" / "candidates.csv", newline="") as file:
        candidates = {row["number"]: int(row["retakes"]) for row in csv.DictReader(file)}
    assert len(candidates) == 40
    for number, retakes in candidates.items():
        takes = [int(row["context"]) for row in taken if row["row"] == number]
        assert takes == list(range(retakes)), (number, retakes, takes)


@pytest.mark.parametrize(("how", "signal"), CRASHES)
def test_a_crash_tells_its_signal_and_its_line(discover: Discover, how: str, signal: str) -> None:
    ran = discover(wrong(how))
    assert ran.returncode == 2 and signal in ran.stderr, ran.stderr
    assert re.search(r'toys.py", line \d+ in step', ran.stderr), ran.stderr


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("toys:Boxed-v0", 'pip install "gymnasium[boxes]"'),
        ("nowhere.inside:Boxed-v0", "finds no module `nowhere`; install it there"),
        ("nowhere:Env", "finds no module `nowhere`; install it there"),
    ],
)
def test_a_package_that_is_missing_is_told_with_how_to_install_it(discover: Discover, target: str, said: str) -> None:
    ran = discover(f'target = "{target}"')
    assert ran.returncode == 2 and said in ran.stderr and "Traceback" not in ran.stderr, ran.stderr
