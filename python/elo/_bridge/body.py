"""Between a body in Python and `backends/src/python/body.rs`: coordinates and torques through arrays that both sides see."""

from __future__ import annotations

import json

import numpy as np

from elo._bridge import BadTarget, find, hashes, origins, versions
from elo.bodies import Array, Body, Joint, Reading, Robot


class Bridge:
    """One body. `torques` and `reading.all` are the arrays that both sides see."""

    def __init__(self, config: str) -> None:
        given = json.loads(config)
        robot = given["robot"]
        self._robot = Robot(**{**robot, "joints": [Joint(**joint) for joint in robot["joints"]]})
        self._files: dict[str, str] = given.get("files", {})
        self._target, self._maker = given["target"], find(given["target"])
        self._body: Body = self._maker(self._robot, **self._files, **given["kwargs"])
        for name in ("set_dynamics", "restore", "advance", "read"):
            if not callable(getattr(self._body, name, None)):
                raise BadTarget(f"`{given['target']}` gave {type(self._body).__name__}, which has no method `{name}`")
        self._reading = Reading(self._robot)
        self.reading, self.torques = self._reading.all, np.zeros(len(self._robot.joints))

    def describe(self) -> str:
        """What there is to know before a run: the versions."""
        return self.versions()

    def versions(self) -> str:
        """What its motion depends on."""
        modules = origins(self._target, self._maker, self._body)
        return ", ".join([versions([type(self._body).__module__, *modules], "mujoco"), *hashes(self._files)])

    def set_dynamics(self, floor_friction: float, payload: float) -> None:
        self._body.set_dynamics(floor_friction, payload)

    def restore(self, positions: Array, velocities: Array) -> None:
        self._body.restore(positions, velocities)
        self._body.read(self._reading)

    def advance(self) -> None:
        self._body.advance(self.torques)
        self._body.read(self._reading)
