"""OpenAI Roboschool's Ant, HalfCheetah and Walker2d on PyPI's Bullet: a Gymnasium environment with settable state.

    pip install pybullet==3.2.7 gymnasium==1.4.0 numpy

Roboschool came with its own build of Bullet. Set up as here, pybullet 3.2.7 behaves like it; the environments that
come with pybullet have other physics. One environment is one Bullet world in this process, without graphics:

    environment = RoboschoolBullet("ant", electricity_cost=-2.0)
    observation, _ = environment.reset(seed=1)
    observation, reward, terminated, _, info = environment.step(environment.action_space.sample())

The robots are described in this file, as MJCF text of our own that Bullet's importer reads; nothing of
`pybullet_data` is used. It has to be that importer, because its habits made Roboschool's bodies: every density is
1000 kg/m3; a link's centre of mass is the middle of its last capsule given by two ends, else the link's frame; its
inertia is that of a bounding box, up to 4 cm too large on each side; Ant's ankle axes stay sqrt 2 long, which makes
ankles heavy and their motors weak. MJCF's motors, springs, dampers and armatures are ignored, and not written here.

Kept from Roboschool: links are seen where they were one sub-step (4 ms) before the step's end. That concerns
`progress`, and height, roll, pitch and yaw of HalfCheetah and Walker2d, whose torso is a link; joints and Ant's torso
are seen at the end.

Changed on purpose: the observation holds the torso's true velocity (Roboschool adds that of the first joint, in
HalfCheetah and Walker2d), and nothing ends an episode but a fall: time limits are the caller's.
"""

from __future__ import annotations

import functools
import math
import os
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pybullet
from gymnasium.spaces import Box

CONTROL_STEP = 0.0165  # simulated seconds between two actions
ELECTRICITY_COST = -2.0  # what Roboschool pays for one unit of electricity, and next for each of the other terms
WEIGHTS = {"alive": 1.0, "progress": 1.0, "stall": -0.1, "joints_at_limit": -0.2, "feet_collision": -1.0}

_SUBSTEPS = 4
_GRAVITY = -9.8  # m/s2, not 9.81
_TARGET = (1000.0, 0.0)  # m; so far ahead that progress is the forward speed
_RESET_NOISE = 0.1  # rad
_BOUND = 5.0  # of every number of the observation
_AT_LIMIT = 0.99  # of half a joint's range, from its middle
_RESTITUTION = 0.5  # of the floor and of the robot; Bullet multiplies the two
_FLOOR_FRICTION = 0.8  # Bullet multiplies it with that of the robot's geoms

_ENGINE = {
    "fixedTimeStep": CONTROL_STEP,
    "numSubSteps": _SUBSTEPS,
    "numSolverIterations": 5,
    "contactERP": 0.9,
    # Friction along two independent directions, and bounces at any speed, as in the Bullet of 2017.
    "enableConeFriction": 0,
    "restitutionVelocityThreshold": 0.0,
    # Without this the order in which contacts are solved, and so the motion, depends on what the process did before.
    "deterministicOverlappingPairs": 1,
    # Bullet's default. It belongs to the process and not to the world: another user of Bullet may have changed it.
    "contactBreakingThreshold": 0.02,
}


@dataclass(frozen=True)
class Robot:
    """A robot's body, and what its task must know of it."""

    mjcf: str
    motors: dict[str, float]  # torque in N m at action 1, by joint, in the order of the actions, which is the file's
    bodies: tuple[str, ...]  # whose contacts a state holds, torso first; links of other names are parts of the torso
    feet: tuple[str, ...]  # bodies whose contacts are observed, in the order of the observation
    min_height: float = -math.inf  # the torso of a living robot is higher than this, in m
    max_pitch: float = math.inf  # and pitched by less than this to either side, in rad
    no_floor_contact: tuple[str, ...] = ()  # a robot dies in a step before which one of these was on the floor


def _mjcf(angle: str, friction: float, torso: str) -> str:
    # With these groups a robot's geoms collide with the floor and not with each other.
    geom = f'<geom contype="1" conaffinity="0" friction="{friction}"/>'
    default = f'<default><joint limited="true"/>{geom}</default>'
    return f'<mujoco><compiler angle="{angle}"/>{default}<worldbody>{torso}</worldbody></mujoco>'


_PLANAR_ROOT = """
    <joint name="root_x" type="slide" axis="1 0 0" limited="false"/>
    <joint name="root_z" type="slide" axis="0 0 1" limited="false"/>
    <joint name="root_y" type="hinge" axis="0 1 0" limited="false"/>"""


def _ant() -> Robot:
    def leg(k: int, foot: str, x: int, y: int) -> str:
        half, whole = f"{0.2 * x} {0.2 * y} 0", f"{0.4 * x} {0.4 * y} 0"
        return f"""
        <body name="leg_{k}" pos="0 0 0">
          <geom type="capsule" size="0.08" fromto="0 0 0 {half}"/>
          <body name="aux_{k}" pos="{half}">
            <joint name="hip_{k}" type="hinge" axis="0 0 1" range="-40 40"/>
            <geom type="capsule" size="0.08" fromto="0 0 0 {half}"/>
            <body name="{foot}" pos="{half}">
              <joint name="ankle_{k}" type="hinge" axis="{-x * y} 1 0" range="{"30 100" if x > 0 else "-100 -30"}"/>
              <geom type="capsule" size="0.08" fromto="0 0 0 {whole}"/>
            </body>
          </body>
        </body>"""

    feet = ("front_left_foot", "front_right_foot", "left_back_foot", "right_back_foot")
    directions = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    legs = "".join(leg(k, foot, x, y) for k, (foot, (x, y)) in enumerate(zip(feet, directions, strict=True), 1))
    return Robot(
        mjcf=_mjcf("degree", 1.5, f'<body name="torso" pos="0 0 0.75"><geom type="sphere" size="0.25"/>{legs}</body>'),
        motors={f"{joint}_{k}": 250.0 for k in (1, 2, 3, 4) for joint in ("hip", "ankle")},
        bodies=("torso", *(name for k, foot in enumerate(feet, 1) for name in (f"aux_{k}", foot))),
        feet=feet,
        min_height=0.26,
    )


def _half_cheetah() -> Robot:
    def part(name: str, pivot: str, limits: str, half: float, middle: str, angle: float, inside: str = "") -> str:
        # A capsule of this half length, whose axis is z turned by the angle about y. Feet weigh 10 kg.
        return f"""
        <body name="{name}" pos="{pivot}">{'<inertial mass="10"/>' if name.endswith("foot") else ""}
          <joint name="{name}" type="hinge" axis="0 1 0" range="{limits}"/>
          <geom type="capsule" size="0.046 {half}" pos="{middle}" axisangle="0 1 0 {angle}"/>{inside}
        </body>"""

    bfoot = part("bfoot", "-0.28 0 -0.14", "-0.4 0.785", 0.094, "0.03 0 -0.097", -0.27)
    bshin = part("bshin", "0.16 0 -0.25", "-0.785 0.785", 0.15, "-0.14 0 -0.07", -2.03, bfoot)
    bthigh = part("bthigh", "-0.5 0 0", "-0.52 1.05", 0.145, "0.1 0 -0.13", -3.8, bshin)
    ffoot = part("ffoot", "0.13 0 -0.18", "-3.1 -0.3", 0.07, "0.045 0 -0.07", -0.6)
    fshin = part("fshin", "-0.14 0 -0.24", "-1.2 1.1", 0.106, "0.065 0 -0.09", -0.6, ffoot)
    fthigh = part("fthigh", "0.5 0 0", "-1.5 0.8", 0.133, "-0.07 0 -0.12", 0.52, fshin)
    torso = f"""
      <body name="torso" pos="0 0 0.7">{_PLANAR_ROOT}
        <geom type="capsule" size="0.046" fromto="-0.5 0 0 0.5 0 0"/>
        <geom type="capsule" size="0.046 0.15" pos="0.6 0 0.1" axisangle="0 1 0 0.87"/>{bthigh}{fthigh}
      </body>"""
    motors = {"bthigh": 108.0, "bshin": 81.0, "bfoot": 54.0, "fthigh": 126.0, "fshin": 54.0, "ffoot": 27.0}
    return Robot(
        mjcf=_mjcf("radian", 0.8, torso),
        motors=motors,
        bodies=("torso", *motors),
        feet=("ffoot", "fshin", "fthigh", "bfoot", "bshin", "bthigh"),
        max_pitch=1.0,
        no_floor_contact=("fshin", "fthigh", "bshin", "bthigh"),
    )


def _walker2d() -> Robot:
    # All frames are at the world's origin, under the feet, where the planar root turns.
    def leg(side: str) -> str:
        return f"""
        <body name="thigh{side}" pos="0 0 0">
          <joint name="thigh{side}_joint" type="hinge" axis="0 -1 0" pos="0 0 1.05" range="-150 0"/>
          <geom type="capsule" size="0.05" fromto="0 0 1.05 0 0 0.6"/>
          <body name="leg{side}" pos="0 0 0">
            <joint name="leg{side}_joint" type="hinge" axis="0 -1 0" pos="0 0 0.6" range="-150 0"/>
            <geom type="capsule" size="0.04" fromto="0 0 0.6 0 0 0.1"/>
            <body name="foot{side}" pos="0 0 0">
              <joint name="foot{side}_joint" type="hinge" axis="0 -1 0" pos="0 0 0.1" range="-45 45"/>
              <geom type="capsule" size="0.06" fromto="0 0 0.1 0.2 0 0.1"/>
            </body>
          </body>
        </body>"""

    back = '<geom type="capsule" size="0.05" fromto="0 0 1.45 0 0 1.05"/>'
    torso = f'<body name="torso" pos="0 0 0">{_PLANAR_ROOT}{back}{leg("")}{leg("_left")}</body>'
    torques = {"thigh": 40.0, "leg": 40.0, "foot": 12.0}
    return Robot(
        mjcf=_mjcf("degree", 0.8, torso),
        motors={f"{part}{side}_joint": torque for side in ("", "_left") for part, torque in torques.items()},
        bodies=("torso", *(f"{part}{side}" for side in ("", "_left") for part in torques)),
        feet=("foot", "foot_left"),
        min_height=0.8,
        max_pitch=1.0,
    )


ROBOTS = {"ant": _ant(), "half-cheetah": _half_cheetah(), "walker2d": _walker2d()}


class _World:
    """A Bullet world of our own: pybullet's functions, told which world they are for."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        if self._client < 0:
            raise RuntimeError("Bullet has no room for another world: close environments that are no longer used")
        self.close = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)

    def __getattr__(self, name: str) -> Any:
        function = functools.partial(getattr(pybullet, name), physicsClientId=self._client)
        setattr(self, name, function)
        return function


class _Reading(NamedTuple):
    """What Bullet says of the robot; the torso's velocity is that of its centre of mass in world axes."""

    height: float
    velocity: Sequence[float]
    roll_pitch_yaw: tuple[float, float, float]
    place: tuple[float, float]  # mean of all links, on the floor's plane
    joints: tuple[float, ...]
    speeds: tuple[float, ...]


class RoboschoolBullet(gymnasium.Env[np.ndarray, np.ndarray]):
    """One of Roboschool's walkers (`robot`: a name in `ROBOTS`), paid for going along +x.

    An action is a share of full torque for each joint; what is beyond ±1 is cut for the motor, but not in the reward.
    An observation is: height of the torso's centre above the reset's; sine and cosine of the angle to the target; 0.3
    times its velocity (m/s) along its heading, to its left and upwards; roll and pitch; for each joint its position
    from -1 to 1 across its range and 0.1 times its velocity (rad/s); for each foot whether it touched the floor when
    the step before this one ended. Everything is cut at ±5.

    `info["reward_terms"]` of a step holds, unpriced,

    - `alive`: 1 while the robot stands, else -1, and the episode ends;
    - `progress`: speed in m/s towards the target, of the mean of all of Bullet's links, massless ones included;
    - `electricity`: mean over the joints of `|a * 0.1 * q'|`, with the velocity after the step in rad/s;
    - `stall`: mean over the joints of `a * a`;
    - `joints_at_limit`: joints within 0.5 % of their range from either end, or beyond;
    - `feet_collision`: feet that touch anything but the floor; there is nothing else, so 0.

    The reward is `electricity_cost` times electricity and `WEIGHTS` times the others. Prices change nothing but the
    reward, so that one episode can be priced for any task. `floating=True` leaves out the floor and gravity.

    A trajectory is a function of the start and the actions, bit for bit, whatever the process did before.
    """

    metadata = {"render_modes": []}
    control_step = CONTROL_STEP

    def __init__(self, robot: str, electricity_cost: float = ELECTRICITY_COST, floating: bool = False) -> None:
        if robot not in ROBOTS:
            raise ValueError(f"robot: expected one of {', '.join(ROBOTS)}, got {robot!r}")
        if not math.isfinite(electricity_cost):
            raise ValueError(f"electricity_cost: expected a finite number, got {electricity_cost}")
        self.robot = robot
        self.weights = WEIGHTS | {"electricity": float(electricity_cost)}
        self._robot = ROBOTS[robot]
        joints, feet = len(self._robot.motors), len(self._robot.feet)
        self.observation_space = Box(-_BOUND, _BOUND, (8 + 2 * joints + feet,), np.float32)
        self.action_space = Box(-1.0, 1.0, (joints,), np.float32)
        self._bullet = _World()
        self._floating = floating
        self._build()
        self._on_floor: list[bool] = []
        self._running = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Puts the robot at its standard pose at rest, with each joint moved by a draw of its own from ±0.1 rad."""
        if options:
            raise ValueError(f"options: expected none, got {', '.join(options)}")
        super().reset(seed=seed)
        noise = self.np_random.uniform(-_RESET_NOISE, _RESET_NOISE, len(self._motors))
        self._restore()
        for joint, position in zip(self._motors, noise.tolist(), strict=True):
            self._bullet.resetJointState(self._body, joint, position)
        reading = self._read(self._link_states())
        feet, bodies = [False] * len(self._feet), [False] * len(self._robot.bodies)
        return self._begin(reading, reading.height, feet, bodies), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Applies `action` for one control step.

        The simulation can go on after a fall; it is the caller who ends the episode. Raises `ValueError` for an action
        of the wrong length or with a component that is not finite, and `RuntimeError` when Bullet lost its state.
        """
        self._check_running()
        shares = _numbers("action", action, len(self._motors))
        torques = self._robot.motors.values()
        forces = [torque * min(1.0, max(-1.0, share)) for torque, share in zip(torques, shares, strict=True)]
        self._bullet.setJointMotorControlArray(self._body, self._motors, pybullet.TORQUE_CONTROL, forces=forces)
        self._bullet.stepSimulation()
        reading = self._read(self._link_states())
        if not math.isfinite(reading.height + sum(reading.place + reading.joints + reading.speeds)):
            self._running = False
            self._bullet.resetSimulation()
            self._build()
            raise RuntimeError("the simulation is unstable: a coordinate is not finite")

        terms = self._reward_terms(shares, reading)
        reward = sum(self.weights[name] * term for name, term in terms.items())
        self._potential = _potential(reading)
        self._feet_shown = [self._on_floor[foot] for foot in self._feet]
        self._on_floor = self._touching()
        return self._observation(reading), reward, terms["alive"] < 0.0, False, {"reward_terms": terms}

    def get_state(self) -> dict[str, np.ndarray]:
        """What `set_state` needs to go on from here.

        `positions` and `velocities` are MuJoCo's `qpos` and `qvel` of the same robot. Ant: the torso's centre (m) and
        its unit quaternion, w first; the centre's velocity in world axes (m/s) and the angular velocity in the
        torso's own axes (rad/s). The others: how far the root has moved along x and z from the standard pose (m) and
        its angle about +y (rad); the root is the torso's centre (HalfCheetah) or the point at the world's origin in
        the standard pose (Walker2d). Then the joints, in the order of the actions.

        `memory` is the torso's height at the reset (m); one flag (0 or 1) a foot, as the present observation shows it;
        one flag a body (`Robot.bodies`), whether it touched the floor when the present step ended.
        """
        self._check_running()
        positions, velocities, *_ = zip(*self._bullet.getJointStates(self._body, self._coordinates), strict=True)
        if self._free:
            place, (x, y, z, w) = self._bullet.getBasePositionAndOrientation(self._body)
            linear, angular = self._bullet.getBaseVelocity(self._body)
            positions = (*place, w, x, y, z, *positions)
            velocities = (*linear, *(_rotation((x, y, z, w)).T @ angular), *velocities)
        memory = [self._height, *self._feet_shown, *self._on_floor]
        state = {"positions": positions, "velocities": velocities, "memory": memory}
        return {name: np.array(numbers, dtype=np.float64) for name, numbers in state.items()}

    def set_state(self, state: Mapping[str, Any]) -> np.ndarray:
        """Puts the world at a state as `get_state` describes it, and returns the observation there.

        States of other engines with the same robot can be given as they are; a key `elapsed` is allowed and without
        effect. Raises `ValueError` for anything that is no such state, and then changes nothing.

        What follows is what would have followed where the state was taken, but for one thing that no state holds: the
        points of contact that Bullet remembers between steps. Here it knows but the last one of each link. A link that
        lies on the floor with both ends may then move differently. Under random actions that happens in no step of Ant,
        0.5 % of HalfCheetah's and 1.3 % of Walker2d's steps on the floor.
        """
        positions, velocities, memory = self._checked_state(state)
        self._restore()
        # Contacts and links as the last sub-step saw them, which is before it moved the robot.
        self._place(self._substep_before(positions, velocities), velocities)
        self._bullet.performCollisionDetection()
        links = self._link_states()
        self._place(positions, velocities)
        flags, feet = [flag == 1.0 for flag in memory[1:]], len(self._feet)
        return self._begin(self._read(links), memory[0], flags[:feet], flags[feet:])

    def close(self) -> None:
        """Frees the world; only `close` may be called afterwards."""
        self._running = False
        self._bullet.close()

    def _build(self) -> None:
        """Makes the world and learns the numbers that Bullet gave to links and joints."""
        bullet = self._bullet
        if not self._floating:
            bullet.setGravity(0.0, 0.0, _GRAVITY)
            floor = bullet.createMultiBody(0.0, bullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=[0, 0, 1]))
            bullet.changeDynamics(floor, -1, lateralFriction=_FLOOR_FRICTION, restitution=_RESTITUTION)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "robot.xml")
            with open(path, "w", encoding="utf-8") as file:
                file.write(self._robot.mjcf)
            (self._body,) = bullet.loadMJCF(path)

        self._links = list(range(bullet.getNumJoints(self._body)))
        for link in (-1, *self._links):
            bullet.changeDynamics(self._body, link, restitution=_RESTITUTION)
        infos = [bullet.getJointInfo(self._body, link) for link in self._links]
        # Hinges and slides, without the fixed joints between a link and its massless helper.
        movable = {info[1].decode(): info for info in infos if info[2] != pybullet.JOINT_FIXED}
        self._coordinates = [info[0] for info in movable.values()]  # the motors' joints are the last
        self._motors = [movable[name][0] for name in self._robot.motors]
        self._limits = [movable[name][8:10] for name in self._robot.motors]
        # Bullet brakes every joint with a motor of its own until it is told not to.
        idle = [0.0] * len(self._coordinates)
        bullet.setJointMotorControlArray(self._body, self._coordinates, pybullet.VELOCITY_CONTROL, forces=idle)

        names = [info[12].decode() for info in infos]
        self._free = "torso" not in names  # A free torso is Bullet's base, number -1, and no link.
        self._torso = -1 if self._free else names.index("torso")
        if not self._free:  # how far the torso's centre of mass is above the root's hinge
            self._lever = bullet.getLinkState(self._body, self._torso)[0][2] - bullet.getLinkState(self._body, 2)[0][2]
        bodies = {name: number for number, name in enumerate(self._robot.bodies)}
        self._body_of_link = {-1: 0} | {link: bodies.get(name, 0) for link, name in enumerate(names)}
        self._feet = [bodies[name] for name in self._robot.feet]
        self._not_on_floor = [bodies[name] for name in self._robot.no_floor_contact]
        self._standard = bullet.saveState()

    def _restore(self) -> None:
        """Makes the world as it was when it was built, in far less time than building it takes."""
        self._running = False
        self._bullet.setPhysicsEngineParameter(**_ENGINE)
        self._bullet.restoreState(self._standard)
        # The robot is in the air now; this drops the points of contact that Bullet remembers.
        self._bullet.performCollisionDetection()

    def _begin(self, reading: _Reading, height: float, feet_shown: list[bool], on_floor: list[bool]) -> np.ndarray:
        self._height = height
        self._feet_shown = feet_shown
        self._on_floor = on_floor
        self._potential = _potential(reading)
        self._running = True
        return self._observation(reading)

    def _place(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Puts the robot at these coordinates, as `get_state` has them."""
        if self._free:
            (*place, w, x, y, z), positions = positions[:7], positions[7:]
            linear, spin, velocities = velocities[:3], velocities[3:6], velocities[6:]
            self._bullet.resetBasePositionAndOrientation(self._body, place, (x, y, z, w))
            self._bullet.resetBaseVelocity(self._body, linear, (_rotation((x, y, z, w)) @ spin).tolist())
        for joint, position, velocity in zip(self._coordinates, positions, velocities, strict=True):
            self._bullet.resetJointState(self._body, joint, position, velocity)

    def _substep_before(self, positions: Sequence[float], velocities: Sequence[float]) -> list[float]:
        """Where the robot was one engine step before, which then added its velocities to its positions."""
        h = CONTROL_STEP / _SUBSTEPS
        if not self._free:
            return [q - h * v for q, v in zip(positions, velocities, strict=True)]
        place = [q - h * v for q, v in zip(positions[:3], velocities[:3], strict=True)]
        joints = [q - h * v for q, v in zip(positions[7:], velocities[6:], strict=True)]
        # The quaternion times that of the turn back, about the angular velocity in the torso's own axes.
        w, x, y, z = positions[3:7]
        spin = math.hypot(*velocities[3:6])
        cos, sin = math.cos(0.5 * h * spin), -math.sin(0.5 * h * spin) / (spin or 1.0)
        i, j, k = (sin * v for v in velocities[3:6])
        turned = [w * cos - x * i - y * j - z * k, w * i + x * cos + y * k - z * j]
        turned += [w * j - x * k + y * cos + z * i, w * k + x * j - y * i + z * cos]
        return place + turned + joints

    def _link_states(self) -> tuple[Any, ...]:
        return self._bullet.getLinkStates(self._body, self._links)

    def _read(self, links: tuple[Any, ...]) -> _Reading:
        """The robot as it is, but with its links as `links` says."""
        positions, speeds, *_ = zip(*self._bullet.getJointStates(self._body, self._coordinates), strict=True)
        if self._free:
            place, quaternion = self._bullet.getBasePositionAndOrientation(self._body)
            velocity, _ = self._bullet.getBaseVelocity(self._body)
        else:
            place, quaternion = links[self._torso][:2]
            (_, _, turn), (forward, up, spin) = positions[:3], speeds[:3]
            swing = spin * self._lever
            velocity = (forward + swing * math.cos(turn), 0.0, up - swing * math.sin(turn))
        x, y, z, w = quaternion
        angles = (
            math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(min(1.0, max(-1.0, 2.0 * (w * y - z * x)))),
            math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        )
        mean = (sum(link[0][0] for link in links) / len(links), sum(link[0][1] for link in links) / len(links))
        joints = len(self._motors)
        return _Reading(place[2], velocity, angles, mean, positions[-joints:], speeds[-joints:])

    def _touching(self) -> list[bool]:
        """Which bodies have a point of contact with the floor; gaps of up to some millimetres count in Bullet."""
        flags = [False] * len(self._robot.bodies)
        for contact in self._bullet.getContactPoints(bodyA=self._body):
            flags[self._body_of_link[contact[3]]] = True
        return flags

    def _normalised(self, reading: _Reading) -> list[float]:
        """The joints' positions across their ranges: -1 and 1 are the limits."""
        joints = zip(reading.joints, self._limits, strict=True)
        return [2.0 * (q - 0.5 * (low + high)) / (high - low) for q, (low, high) in joints]

    def _observation(self, reading: _Reading) -> np.ndarray:
        roll, pitch, yaw = reading.roll_pitch_yaw
        to_target = math.atan2(_TARGET[1] - reading.place[1], _TARGET[0] - reading.place[0]) - yaw
        vx, vy, vz = reading.velocity
        forward, left = math.cos(yaw) * vx + math.sin(yaw) * vy, math.cos(yaw) * vy - math.sin(yaw) * vx
        numbers = [reading.height - self._height, math.sin(to_target), math.cos(to_target)]
        numbers += [0.3 * forward, 0.3 * left, 0.3 * vz, roll, pitch]
        for position, speed in zip(self._normalised(reading), reading.speeds, strict=True):
            numbers += [position, 0.1 * speed]
        return np.clip(numbers + self._feet_shown, -_BOUND, _BOUND).astype(np.float32)

    def _reward_terms(self, shares: list[float], reading: _Reading) -> dict[str, float]:
        robot = self._robot
        stands = reading.height > robot.min_height and abs(reading.roll_pitch_yaw[1]) < robot.max_pitch
        fell = any(self._on_floor[body] for body in self._not_on_floor)
        powers = [abs(a * 0.1 * speed) for a, speed in zip(shares, reading.speeds, strict=True)]
        return {
            "alive": 1.0 if stands and not fell else -1.0,
            "progress": _potential(reading) - self._potential,
            "electricity": sum(powers) / len(powers),
            "stall": sum(a * a for a in shares) / len(shares),
            "joints_at_limit": float(sum(abs(x) > _AT_LIMIT for x in self._normalised(reading))),
            "feet_collision": 0.0,
        }

    def _check_running(self) -> None:
        if not self._running:
            raise gymnasium.error.ResetNeeded("no episode is running: call reset or set_state first")

    def _checked_state(self, state: Mapping[str, Any]) -> tuple[list[float], list[float], list[float]]:
        known = ("positions", "velocities", "memory", "elapsed")
        if unknown := [name for name in state if name not in known]:
            raise ValueError(f"state: expected {', '.join(known[:3])}, got {', '.join(unknown)}")
        root, joints = (7, 6) if self._free else (0, 0), len(self._coordinates)
        positions = _numbers("positions", state.get("positions", ()), root[0] + joints)
        velocities = _numbers("velocities", state.get("velocities", ()), root[1] + joints)
        memory = _numbers("memory", state.get("memory", ()), 1 + len(self._feet) + len(self._robot.bodies))
        if any(flag not in (0.0, 1.0) for flag in memory[1:]):
            raise ValueError(f"memory: expected flags of 0 or 1 after the height, got {memory[1:]}")
        if self._free:
            length = math.hypot(*positions[3:7])
            if abs(length - 1.0) > 1e-3:
                raise ValueError(f"positions: expected a unit quaternion, got {positions[3:7]}")
            positions[3:7] = [x / length for x in positions[3:7]]
        return positions, velocities, memory


def _numbers(name: str, values: Any, length: int) -> list[float]:
    """So many finite numbers, or a `ValueError`."""
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (length,):
        raise ValueError(f"{name}: expected {length} numbers, got an array of shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers, got {array.tolist()}")
    return array.tolist()


def _potential(reading: _Reading) -> float:
    """Minus the distance to the target over the control step: its change is a speed."""
    return -math.hypot(_TARGET[0] - reading.place[0], _TARGET[1] - reading.place[1]) / CONTROL_STEP


def _rotation(quaternion: Sequence[float]) -> np.ndarray:
    """The matrix of a unit quaternion, w last."""
    return np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
