"""Suites that say whether an environment, a teacher or a metric of one's own keeps the rules that results rest on.

Each takes the table that a config has for it, prints a report, and gives the names of the rules that are broken: an empty list
when it keeps them all. Raises ValueError for a table with faults or for code that cannot be found or run.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from elo import _elo

POINT_MASS = {"kind": "point_mass"}
"""A toy simulator: a mass on a line, with 2 observations and 1 action."""


def _run(role: str, config: Mapping[str, Any], simulator: Mapping[str, Any]) -> list[str]:
    broken, report = _elo.conformance(role, json.dumps(dict(config)), json.dumps(dict(simulator)))
    print(report)
    return broken


def simulator(config: Mapping[str, Any]) -> list[str]:
    """Of a `[simulator]` table. Takes about 8,000 steps.

    The rule to look for in an environment of one's own is that episodes repeat bit for bit, in a fresh object, in a used one,
    in another order and after an error: without it no result can be trusted.
    """
    return _run("simulator", config, POINT_MASS)


def teacher(config: Mapping[str, Any], simulator: Mapping[str, Any]) -> list[str]:
    """Of a `[teacher]` table, on the robot of a `[simulator]` table. File paths are relative to the working directory."""
    return _run("teacher", config, simulator)


def metric(config: Mapping[str, Any]) -> list[str]:
    """Of a `[[metrics]]` table."""
    return _run("metric", config, POINT_MASS)
