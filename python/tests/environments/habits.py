"""Masses with a habit each that only shows outside an episode."""

from __future__ import annotations

import atexit
import os
import signal
import time
from pathlib import Path
from typing import Any

import elo.bodies
import numpy as np
import toys


class Logged(toys.Mass):
    """Writes to the file `log` when it is made and when it is closed, and once more when its process ends in order."""

    def __init__(self, log: str, weight: float = 1.0) -> None:
        super().__init__(weight)
        self.log = log
        self._write("made")
        atexit.register(self._write, "over")

    def _write(self, what: str) -> None:
        with open(self.log, "a") as file:
            file.write(f"{what} {id(self)} {os.getpid()}\n")

    def close(self) -> None:
        self._write("closed")
        raise RuntimeError("nobody is to hear of this")


class Slow(toys.Mass):
    """Takes 10 ms over each step, and ends after fifteen."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        self.steps = 0
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> Any:
        time.sleep(0.01)
        self.steps += 1
        observation, reward, _, truncated, info = super().step(action)
        return observation, reward, self.steps >= 15, truncated, info


class Homely(toys.Mass):
    """Knows in which process it is."""

    def step(self, action: Any) -> Any:
        observation, *rest = super().step(action)
        return observation + np.float32(os.getpid()), *rest


class Geared(toys.Mass):
    """Its weight is in the file `gear`."""

    def __init__(self, gear: str) -> None:
        super().__init__(float(Path(gear).read_text()))


class Greased(elo.bodies.MujocoBody):
    """What it is turned by is in the file `gear`."""

    def __init__(self, robot: Any, gear: str) -> None:
        super().__init__(robot)
        self.gear = float(Path(gear).read_text())

    def advance(self, torques: Any) -> None:
        super().advance(self.gear * torques)


class Interrupted(toys.Mass):
    """Somebody presses Ctrl-C in its third step, or its script exits there."""

    steps = 0

    def __init__(self, how: str) -> None:
        super().__init__()
        self.how = how

    def step(self, action: Any) -> Any:
        Interrupted.steps += 1
        if Interrupted.steps == 3 and self.how == "exit":
            raise SystemExit(7)
        if Interrupted.steps == 3:
            signal.raise_signal(signal.SIGINT)
        return super().step(action)


def interrupted_teacher(task: dict[str, float], seed: int) -> Any:
    """Somebody presses Ctrl-C while it acts."""

    def act(observation: Any, noise: Any) -> Any:
        if observation.any():
            signal.raise_signal(signal.SIGINT)
        return np.zeros(1)

    return act


def interrupted_score(returns: Any, mean: float, standard_deviation: float) -> Any:
    """Somebody presses Ctrl-C when it is asked for the second time."""
    Interrupted.steps += 1
    if Interrupted.steps == 2:
        signal.raise_signal(signal.SIGINT)
    return returns.mean(axis=1)
