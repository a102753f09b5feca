"""Physics engines in Python that only move a robot's bodies: observation, reward and ends are computed in Rust, as for the
engines there.

A `[simulator]` table of `kind = "python_body"` names a callable that makes such a body; `MujocoBody` is one.
"""

from __future__ import annotations

import copy
import importlib
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from elo._bridge import BadTarget

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Joint:
    """A joint with a motor."""

    name: str
    position: int
    """Its place among the generalised positions."""
    velocity: int
    """Its place among the generalised velocities."""


@dataclass(frozen=True)
class Robot:
    """The robot that a body is made of. Generalised positions and velocities are ordered as MuJoCo orders the file's joints."""

    name: str
    mjcf: str
    """The text of its MJCF file."""
    substeps: int
    """Engine steps (the file's `timestep`) in one control step."""
    torso: int
    """The place of the torso in `bodies`."""
    bodies: Sequence[str]
    """Names, in the order of the file, without the world."""
    joints: Sequence[Joint]
    """In the order of the file's motors."""
    positions: int
    """How many generalised positions there are."""
    velocities: int
    """How many generalised velocities there are."""


class Reading:
    """Where everything is, for a body to fill in. All arrays are of float64, in m, rad, m/s and rad/s.

    Write into them, `reading.positions[:] = …`: an array of your own in the place of one of them would be read by nobody, and
    assigning one raises AttributeError.
    """

    def __init__(self, robot: Robot) -> None:
        bodies, joints = len(robot.bodies), len(robot.joints)
        sizes = [3 * bodies, 4 * bodies, 3, joints, joints, bodies, robot.positions, robot.velocities]
        self._all: Array = np.zeros(sum(sizes))
        self._parts = np.split(self._all, np.cumsum(sizes)[:-1])
        self._parts[:2] = self._parts[0].reshape(bodies, 3), self._parts[1].reshape(bodies, 4)

    @property
    def all(self) -> Array:
        """All of them, one after the other."""
        return self._all

    @property
    def body_positions(self) -> Array:
        """Of each body's frame, in the world."""
        return self._parts[0]

    @property
    def body_rotations(self) -> Array:
        """Unit quaternions of each body's frame, w first."""
        return self._parts[1]

    @property
    def torso_velocity(self) -> Array:
        """Linear velocity of the torso's centre of mass, in world axes."""
        return self._parts[2]

    @property
    def joint_positions(self) -> Array:
        """Of the joints with motors, in the order of the motors."""
        return self._parts[3]

    @property
    def joint_velocities(self) -> Array:
        """Of the joints with motors, in the order of the motors."""
        return self._parts[4]

    @property
    def on_floor(self) -> Array:
        """1 for bodies that touch the floor, 0 for the others."""
        return self._parts[5]

    @property
    def positions(self) -> Array:
        """Generalised positions."""
        return self._parts[6]

    @property
    def velocities(self) -> Array:
        """Generalised velocities."""
        return self._parts[7]


class Body(Protocol):
    """A robot in an engine. What follows a `restore` must depend on nothing that was before it."""

    def set_dynamics(self, floor_friction: float, payload: float) -> None:
        """Sets the floor's sliding friction coefficient and the mass added at the torso's centre of mass, in kg."""

    def restore(self, positions: Array, velocities: Array) -> None:
        """Forgets everything and puts the robot at these generalised coordinates."""

    def advance(self, torques: Array) -> None:
        """Takes one control step with a constant torque (N m) on each joint with a motor.

        Raises any exception when the engine's numbers can no longer be trusted.
        """

    def read(self, reading: Reading) -> None:
        """Says where everything is now."""


class MujocoBody:
    """A robot in MuJoCo's Python bindings (`pip install mujoco`), step for step what the engine in Rust does.

    `version` is the version that must be installed.
    """

    def __init__(self, robot: Robot, version: str = "3.17.0") -> None:
        try:
            mujoco: Any = importlib.import_module("mujoco")
        except ImportError as error:
            raise BadTarget(f"MuJoCo is missing in {sys.executable}: pip install mujoco=={version}") from error
        if mujoco.__version__ != version:
            raise BadTarget(
                f"MuJoCo in {sys.executable} is {mujoco.__version__}, expected {version}: pip install mujoco=={version}"
            )
        self._mujoco = mujoco
        self._pristine = mujoco.MjModel.from_xml_string(robot.mjcf)
        self._substeps, self._torso = robot.substeps, robot.torso + 1
        self._joint_positions = np.array([joint.position for joint in robot.joints])
        self._joint_velocities = np.array([joint.velocity for joint in robot.joints])
        planes = self._pristine.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._floor = int(np.flatnonzero(planes & (self._pristine.geom_bodyid == 0))[0])
        self._whole_steps = self._pristine.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        self._use(self._pristine)

    def _use(self, model: Any) -> None:
        self._model, self._data = model, self._mujoco.MjData(model)

    def set_dynamics(self, floor_friction: float, payload: float) -> None:
        model = copy.copy(self._pristine)
        model.geom_friction[self._floor, 0] = floor_friction
        model.body_mass[self._torso] += payload
        self._use(model)
        if payload != 0.0:
            # Recomputes what MuJoCo derives from masses.
            self._mujoco.mj_setConst(model, self._data)
        self._mujoco.mj_resetData(model, self._data)

    def restore(self, positions: Array, velocities: Array) -> None:
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = positions, velocities
        self._mujoco.mj_step1(self._model, self._data)
        self._check()

    def advance(self, torques: Array) -> None:
        before = self._data.time
        self._data.qfrc_applied[:] = 0.0
        np.add.at(self._data.qfrc_applied, self._joint_velocities, torques)
        # A step alternates MuJoCo's halves, second half first: what is read belongs to the state that it ends with.
        if self._whole_steps:
            self._mujoco.mj_step(self._model, self._data, self._substeps)
            self._mujoco.mj_step1(self._model, self._data)
        else:
            for _ in range(self._substeps):
                self._mujoco.mj_step2(self._model, self._data)
                self._mujoco.mj_step1(self._model, self._data)
        self._check()
        if not self._data.time > before:
            raise RuntimeError("time did not advance")

    def _check(self) -> None:
        numbers = self._data.warning.number
        if numbers.any():
            kind = self._mujoco.mjtWarning(int(np.flatnonzero(numbers)[0]))
            raise RuntimeError(f"MuJoCo warns of {kind.name}")

    def read(self, reading: Reading) -> None:
        model, data = self._model, self._data
        reading.body_positions[:], reading.body_rotations[:] = data.xpos[1:], data.xquat[1:]
        # MuJoCo keeps velocities about the centre of mass of the whole tree.
        wx, wy, wz, vx, vy, vz = data.cvel[self._torso].tolist()
        root = model.body_rootid[self._torso]
        x, y, z = (data.xipos[self._torso] - data.subtree_com[root]).tolist()
        reading.torso_velocity[:] = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
        reading.joint_positions[:] = data.qpos[self._joint_positions]
        reading.joint_velocities[:] = data.qvel[self._joint_velocities]
        reading.positions[:], reading.velocities[:] = data.qpos, data.qvel
        reading.on_floor[:] = 0.0
        contact = data.contact
        geoms = contact.geom[contact.exclude == 0]
        touching = geoms[(geoms == self._floor).sum(axis=1) == 1]
        bodies = model.geom_bodyid[touching[touching != self._floor]]
        reading.on_floor[bodies[bodies > 0] - 1] = 1.0
