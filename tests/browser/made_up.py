"""Experiments and films for a finished run that has none: made up, but of the right shape and beside its own report."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import Any

Json = dict[str, Any]

TRUNK = 0
LEGS = 4
CONTROL_STEP = 1 / 60


def _interval(middle: float, half: float) -> Json:
    return {"estimate": middle, "low": middle - half, "high": middle + half}


def _agent(row: Json, members: int, contexts: int, draw: random.Random) -> Json:
    mean = row["mean_return"]["estimate"]
    returns = [mean + abs(mean) * 0.4 * draw.gauss(0, 1) + 6 * draw.gauss(0, 1) for _ in range(members * contexts)]
    return {"row": row, "returns": returns, "falls": {"falls": contexts - 1, "rollouts": contexts, "upper": 0.9991}}


def _curve(row: Json, last: float) -> list[Json]:
    points = []
    for index in range(21):
        level = last * (1 - math.exp(-index / 7)) - 3 * math.exp(-index)
        sampled = row | {"mean_return": _interval(level, 4 + index * 0.3)}
        acting = row | {"mean_return": _interval(level * 1.25, 4 + index * 0.4)}
        points.append({"steps": 20000 * index, "sampled": sampled, "mean_action": acting})
    return points


def _tail(metric: str, side: str, value: str, mean: Json) -> Json:
    return {
        "metric": metric, "baseline": "maximum_mean", "set_value": value, "side": side, "threshold": 0.156,
        "baseline_mean": mean, "baseline_area": _interval(0.19, 0.06), "baseline_smooth": 0.2034,
        "mean": mean, "area": _interval(0.12, 0.05), "smooth": 0.1312, "improvement": _interval(0.37, 0.21),
    }  # fmt: skip


def experiments(report: Json) -> Json:
    """Experiments whose agents earn what they earn in the report."""
    draw = random.Random(1)
    contexts = report["starts"]["contexts"]
    sets, baselines = report["sets"], report["baselines"]
    agents = [_agent(s["row"], len(s["options"]), contexts, draw) for s in sets]
    agents += [_agent(row, 3 if row["name"] == "random K-subsets" else 1, contexts, draw) for row in baselines]
    steps = [{"at": 41250.75}, "below_curve", "above_curve"]
    equivalents = [
        {
            "agent": s["metric"], "acting": acting, "level": s["row"]["mean_return"],
            "steps": steps[index % 3], "low": {"at": 20125.0}, "high": {"at": 81000.5},
        }
        for index, s in enumerate(sets)
        for acting in ("sampled", "mean_action")
    ]  # fmt: skip
    mean = sets[0]["row"]["mean"]
    tails = [
        _tail(s["metric"], side, value, mean)
        for s, side in zip(sets[1:], ("lower", "upper"), strict=False)
        for value in ("mixture", "average")
    ]
    sweep = [
        {
            "kind": kind, "k": k, "options": [1, 2, 3], "mean": mean,
            "area": _interval(0.3 - 0.1 * k, 0.04 + 0.02 * k),
        }
        for kind in ("negative_tail", "positive_skew")
        for k in (0.05, 0.1, 0.25, 0.5, 0.75, 1.0)
    ]  # fmt: skip
    spreads = [{"metric": s["metric"], "scores": [0.1, 0.2], "near_best": 0.225} for s in sets]
    last = max(row["mean_return"]["estimate"] for row in baselines)
    return {
        "format": 1, "robot": report["robot"], "engine": report["engine"], "seed": report["seed"], "contexts": contexts,
        "steps": 200, "agents": agents, "curve": _curve(baselines[-1], last), "equivalents": equivalents,
        "tails": tails, "sweep": sweep, "spreads": spreads,
    }  # fmt: skip


def _pose(position: list[float], angle: float) -> Json:
    """A pose that is turned about y."""
    return {"position": position, "rotation": [math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]}


def _film(pace: float, steps: int) -> Json:
    frames = []
    for index in range(steps + 1):
        x, phase = pace * index * CONTROL_STEP, index * 0.15
        frame = [_pose([x, 0.0, 0.6 + 0.02 * math.sin(2 * phase)], 0.05 * math.sin(phase))]
        for leg in range(LEGS):
            hip = [x + (0.22 if leg < 2 else -0.22), 0.1 if leg % 2 else -0.1, 0.52]
            frame.append(_pose(hip, 0.5 * math.sin(phase + leg * math.pi)))
        frames.append(frame)
    return {"steps": frames, "returns": 17.25 * pace}


def _scene() -> Json:
    solids = [
        {"body": TRUNK, "pose": _pose([0.0, 0.0, 0.0], 0.0), "shape": {"box": {"half_size": [0.3, 0.12, 0.1]}}},
        {"body": TRUNK, "pose": _pose([0.38, 0.0, 0.12], 0.0), "shape": {"sphere": {"radius": 0.1}}},
    ]
    for leg in range(LEGS):
        shape = {"capsule": {"radius": 0.05, "half_length": 0.2}}
        solids.append({"body": 1 + leg, "pose": _pose([0.0, 0.0, -0.24], 0.0), "shape": shape})
    return {"bodies": ["trunk"] + [f"leg {leg}" for leg in range(LEGS)], "solids": solids, "floor": True}


def replays(report: Json) -> list[Json]:
    """A walk of each option in two contexts, on two engines."""
    who = sorted({option["row"]["name"] for s in report["sets"] for option in s["options"]})

    def engine(name: str, version: str, pace: float) -> Json:
        films = [
            {"who": name, "context": context, "film": _film(pace + 0.05 * index, 150)}
            for index, name in enumerate(who)
            for context in (0, 1)
        ]
        return {"engine": {"name": name, "version": version}, "control_step": CONTROL_STEP, "scene": _scene(), "films": films}

    return [engine("rapier", "0.36.1", 1.0), engine("mujoco", "3.17.0", 0.7)]


def complete(run: Path) -> None:
    """Gives the run in this folder what it lacks."""
    results = run / "results"
    report = json.loads((results / "report.json").read_text())
    (results / "experiments.json").write_text(json.dumps(experiments(report)))
    (results / "replay.json").write_text(json.dumps(replays(report)))
