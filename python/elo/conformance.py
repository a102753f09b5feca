"""Suites that say whether an environment, a teacher or a metric of one's own keeps the rules that results rest on.

Each takes the table that a config has for it, prints a report, and gives the names of the rules that are broken: an empty list
when it keeps them all. Raises ValueError for a table with faults or for code that cannot be found or run.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elo import _elo

POINT_MASS = {"kind": "point_mass"}
"""A toy simulator: a mass on a line, with 2 observations and 1 action."""

ANOTHER_PROCESS_REPEATS = "another_process_repeats"
"""The rule that is tried here, beside those of the extension module: workers are processes, and there are several."""

RULE = "Another process gives the same episode, bit for bit."
STEPS = 60
"""Control steps of the episode that is played for it."""

Episode = npt.NDArray[np.float64]
"""A row for the reset and one for each step: observation, reward terms, and whether it terminated or was truncated."""


def simulator(config: Mapping[str, Any]) -> list[str]:
    """Of a `[simulator]` table. Takes about 8,000 steps, and a second process for some more.

    The rule to look for in an environment of one's own is that episodes repeat bit for bit, in a fresh object, in a used one,
    in another order, after an error and in another process: without it no result can be trusted.
    """
    table = _table(config)
    broken, report = _elo.conformance("simulator", json.dumps(table), json.dumps(POINT_MASS))
    violation = _elsewhere(table)
    print(_with_another_rule(report, violation))
    return broken + [ANOTHER_PROCESS_REPEATS] * (violation is not None)


def teacher(config: Mapping[str, Any], simulator: Mapping[str, Any]) -> list[str]:
    """Of a `[teacher]` table, on the robot of a `[simulator]` table. File paths are relative to the working directory."""
    return _run("teacher", config, simulator)


def metric(config: Mapping[str, Any]) -> list[str]:
    """Of a `[[metrics]]` table."""
    return _run("metric", config, POINT_MASS)


def _table(config: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(config, Mapping):
        raise TypeError(f"expected a table of a config, such as {{'kind': 'python', 'target': 'module:name'}}, got {config!r}")
    return dict(config)


def _run(role: str, config: Mapping[str, Any], simulator: Mapping[str, Any]) -> list[str]:
    broken, report = _elo.conformance(role, json.dumps(_table(config)), json.dumps(_table(simulator)))
    print(report)
    return broken


def _with_another_rule(report: str, violation: str | None) -> str:
    """The extension module's report with the rule that was tried here."""
    head, *lines = report.split("\n")
    subject, counts = head.rsplit(": ", 1)
    passed, failed, skipped = (int(count.split()[0]) for count in counts.split(", "))
    if violation is None:
        passed += 1
    else:
        failed += 1
        lines += [f"  FAILED  {ANOTHER_PROCESS_REPEATS}: {violation}", f"          ({RULE})"]
    return "\n".join([f"{subject}: {passed} passed, {failed} failed, {skipped} skipped", *lines])


def _elsewhere(config: dict[str, Any]) -> str | None:
    """How an episode in another process differs from the same one here, if it does."""
    try:
        names, here = _episode(config)
    except (RuntimeError, ValueError) as error:
        return f"in this process: expected an episode, got {_last_line(str(error))}"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "episode.npy"
        # Not on its standard output, to which environments may write.
        order = {"path": [str(place) for place in sys.path], "config": config, "file": str(file)}
        program = "import json, sys; order = json.load(sys.stdin); sys.path[:] = order['path']; "
        program += "from elo import conformance; conformance._play(order)"
        ran = subprocess.run([sys.executable, "-c", program], input=json.dumps(order), capture_output=True, text=True, check=False)
        if not file.exists():
            return f"in the other process: expected an episode, got {_end(ran)}"
        return _difference(names, here, np.load(file))


def _play(order: Mapping[str, Any]) -> None:
    """What the other process does."""
    _, episode = _episode(order["config"])
    np.save(order["file"], episode)


def _episode(config: dict[str, Any]) -> tuple[list[str], Episode]:
    """The names of its columns, and an episode with actions at random."""
    simulator = _elo.Simulator(json.dumps(config))
    spec = json.loads(simulator.spec())
    names = [f"observation[{i}]" for i in range(spec["observation_size"])]
    names += [f"reward term `{term['name']}`" for term in spec["reward_terms"]] + ["terminated", "truncated"]
    generator = np.random.default_rng(1)
    nothing_yet = np.zeros(len(spec["reward_terms"]) + 2)
    rows = [np.concatenate([simulator.reset("{}", json.dumps({"seed": 1})), nothing_yet])]
    for _ in range(STEPS):
        action = generator.uniform(spec["action_low"], spec["action_high"]).astype(np.float32)
        observation, terms, *ends = simulator.step(action)
        rows.append(np.concatenate([observation, terms, ends]))
        if any(ends):
            break
    return names, np.array(rows, np.float64)


def _difference(names: list[str], here: Episode, there: Episode) -> str | None:
    if here.shape[1] != there.shape[1]:
        return f"numbers in observation and reward: expected {here.shape[1] - 2}, got {there.shape[1] - 2}"
    common = min(len(here), len(there))
    # Where only one of the two ends, that row differs.
    differing = np.argwhere(here[:common].view(np.int64) != there[:common].view(np.int64))
    if not len(differing):
        return None
    step, column = differing[0]
    return f"step {step}: {names[column]}: expected {here[step, column]}, got {there[step, column]}"


def _end(ran: subprocess.CompletedProcess[str]) -> str:
    """How a process ended that gave nothing."""
    code = ran.returncode
    ended = f"signal {-code} ({signal.Signals(-code).name})" if code < 0 else f"exit code {code}"
    said = _last_line(ran.stderr)
    return f"{ended}: {said}" if said else ended


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or [""])[-1]
