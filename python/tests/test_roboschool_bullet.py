"""Tests of `examples/python/roboschool_bullet.py`, against recordings and figures of Roboschool itself.

    pip install pybullet==3.2.7 gymnasium==1.4.0 numpy pytest
    pytest python/tests/test_roboschool_bullet.py

`-s` shows what was measured.
"""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pybullet = pytest.importorskip("pybullet")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "python"
sys.path.insert(0, str(EXAMPLES))

from roboschool_bullet import CONTROL_STEP, ROBOTS, WEIGHTS, RoboschoolBullet  # noqa: E402

RECORDED = json.loads((Path(__file__).parent / "data" / "roboschool_trajectories.json").read_text(encoding="utf-8"))
TOLERANCE = 1e-6  # the recordings are rounded to six decimals, half of this

NUMBERS = {"ant": (8, 4, 9), "half-cheetah": (6, 6, 7), "walker2d": (6, 2, 7)}  # joints, feet, bodies
HIP, CALF = 40 * math.pi / 180, 150 * math.pi / 180
INNER, OUTER, HEEL = math.pi / 6, math.pi / 1.8, math.pi / 4
LIMITS = {
    "ant": [(-HIP, HIP), (INNER, OUTER), (-HIP, HIP), (-OUTER, -INNER)] * 2,
    "half-cheetah": [(-0.52, 1.05), (-0.785, 0.785), (-0.4, 0.785), (-1.5, 0.8), (-1.2, 1.1), (-3.1, -0.3)],
    "walker2d": [(-CALF, 0.0), (-CALF, 0.0), (-HEEL, HEEL)] * 2,
}
LIMITS["ant"][5], LIMITS["ant"][7] = LIMITS["ant"][3], LIMITS["ant"][1]

Make = Callable[..., RoboschoolBullet]


@pytest.fixture
def make() -> Iterator[Make]:
    """Makes environments that are closed after the test."""
    made = []

    def one(*arguments: Any, **named: Any) -> RoboschoolBullet:
        made.append(RoboschoolBullet(*arguments, **named))
        return made[-1]

    yield one
    for environment in made:
        environment.close()


def actions_for(robot: str, steps: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, NUMBERS[robot][0]))


def standard_state(environment: RoboschoolBullet) -> dict[str, np.ndarray]:
    """The reset's state without its noise."""
    environment.reset(seed=0)
    state = environment.get_state()
    state["positions"][-NUMBERS[environment.robot][0] :] = 0.0
    return state


# Against recordings.


@pytest.mark.parametrize(
    "recorded",
    RECORDED["trajectories"],
    ids=lambda r: f"{r['robot']}-{r['kind']}{'-floating' if r['floating'] else ''}",
)
def test_motion_reward_and_contacts_are_the_recorded_ones(make: Make, recorded: dict[str, Any]) -> None:
    environment = make(recorded["robot"], floating=recorded["floating"])
    environment.set_state(standard_state(environment))
    joints, feet, _ = NUMBERS[recorded["robot"]]
    robot = ROBOTS[recorded["robot"]]
    on_floor = [1 + feet + robot.bodies.index(foot) for foot in robot.feet]
    differences, first = [], None
    for step, action in enumerate(recorded["actions"]):
        _, _, terminated, _, info = environment.step(np.array(action))
        state, terms = environment.get_state(), info["reward_terms"]
        paid = [terms[name] * WEIGHTS[name] for name in ("alive", "progress", "joints_at_limit", "feet_collision")]
        paid.insert(2, -2.0 * terms["electricity"] - 0.1 * terms["stall"])
        got = [*state["positions"][-joints:], *state["velocities"][-joints:], *paid]
        expected = [*recorded["q"][step], *recorded["qd"][step], *recorded["rewards"][step]]
        differences.append(np.abs(np.subtract(got, expected)))
        assert terminated == recorded["done"][step], f"step {step}"
        assert state["memory"][on_floor].tolist() == recorded["feet_contact"][step], f"step {step}"
        if first is None and state["memory"][1 + feet :].any():
            first = step
    worst = np.max(differences, axis=1)
    print(f"largest difference {worst[:first].max():.2e} before the first contact", end="")
    print("" if first is None else f" in step {first}, {worst[first:].max():.2e} from there to step {len(worst) - 1}")
    assert len(worst) == 50
    # Contacts do not loosen it: Bullet is deterministic once its contacts are in a fixed order.
    assert (worst < TOLERANCE).all(), f"first in step {np.argmax(worst >= TOLERANCE)}: {worst.max()}"


# Against the random policy's figures: 100 episodes of at most 200 steps with uniformly random actions, measured with
# pybullet 3.2.7 set up as Roboschool. `return` has its standard deviation. The last five rows are what the terms pay a
# step, averaged over all steps of all episodes; `electricity` includes `stall`.
RANDOM_POLICY: dict[str, dict[str, Any]] = {
    "ant": {
        "return": (25.4, 21.0),
        "length": 182.7,
        "ended": 0.13,
        "sum of electricity": 8.03,
        "alive": 0.999,
        "progress": 0.001,
        "electricity": -0.121,
        "joints_at_limit": -0.739,
        "feet_collision": 0.0,
    },
    "half-cheetah": {
        "return": (0.5, 4.4),
        "length": 18.1,
        "ended": 1.0,
        "sum of electricity": 5.65,
        "alive": 0.890,
        "progress": -0.006,
        "electricity": -0.656,
        "joints_at_limit": -0.200,
        "feet_collision": 0.0,
    },
    "walker2d": {
        "return": (16.1, 3.3),
        "length": 13.7,
        "ended": 1.0,
        "sum of electricity": 2.95,
        "alive": 0.853,
        "progress": 0.965,
        "electricity": -0.466,
        "joints_at_limit": -0.175,
        "feet_collision": 0.0,
    },
}


PER_STEP = ("alive", "progress", "electricity", "joints_at_limit", "feet_collision")


def random_episodes(environment: RoboschoolBullet, episodes: int, seed: int) -> dict[str, np.ndarray]:
    """Sums over each episode, by the names above."""
    generator = np.random.default_rng(seed)
    rows = []
    for episode in range(episodes):
        environment.reset(seed=1000 * seed + episode)
        total, sums, length, terminated = 0.0, np.zeros(6), 0, False
        while length < 200 and not terminated:
            action = generator.uniform(-1.0, 1.0, NUMBERS[environment.robot][0])
            _, reward, terminated, _, info = environment.step(action)
            total, length = total + reward, length + 1
            sums += list(info["reward_terms"].values())
        rows.append((total, length, terminated, *sums))
    names = ["return", "length", "ended", *info["reward_terms"]]
    columns = dict(zip(names, np.array(rows).T, strict=True))
    columns["sum of electricity"] = columns["electricity"]
    columns["electricity"] = -2.0 * columns["electricity"] - 0.1 * columns.pop("stall")
    columns["joints_at_limit"] = -0.2 * columns["joints_at_limit"]
    return columns


@pytest.mark.parametrize("robot", ["ant", "half-cheetah", "walker2d"])
def test_random_policy_earns_what_it_earned_in_roboschool(make: Make, robot: str) -> None:
    episodes = 1000
    began = time.perf_counter()
    columns = random_episodes(make(robot), episodes, seed=1)
    seconds, steps = time.perf_counter() - began, columns["length"].sum()
    print(f"{episodes} episodes, {steps:.0f} steps in {seconds:.1f} s: {steps / seconds:.0f} steps/s with resets")
    far = []
    for name, figure in RANDOM_POLICY[robot].items():
        values, mean = columns[name], columns[name].mean()
        if name in PER_STEP:
            # A ratio of means: to first order its error is that of the mean of (sum - ratio * length) / mean length.
            mean = values.sum() / steps
            values = (values - mean * columns["length"]) / columns["length"].mean()
        spread = values.std(ddof=1)
        # Where the table has no deviation of its own, that of these episodes stands in for it.
        expected, table_spread = figure if isinstance(figure, tuple) else (figure, spread)
        error = math.hypot(spread / math.sqrt(episodes), table_spread / math.sqrt(100))
        distance = abs(mean - expected)
        print(f"  {name:20} {mean:9.4f}, expected {expected:8.3f}: {distance / error if error else 0.0:.2f} errors")
        if distance > 4.0 * error:
            far.append(name)
    assert not far


# Determinism.


def trajectory(environment: RoboschoolBullet, seed: int, steps: int) -> bytes:
    """Every number that an episode shows."""
    parts = [environment.reset(seed=seed)[0].tobytes()]
    for action in actions_for(environment.robot, steps, seed):
        observation, reward, terminated, _, info = environment.step(action)
        parts += [observation.tobytes(), np.array([reward, terminated, *info["reward_terms"].values()]).tobytes()]
        parts += [numbers.tobytes() for numbers in environment.get_state().values()]
    return b"".join(parts)


@pytest.mark.parametrize("robot", ROBOTS)
def test_history_does_not_matter(make: Make, robot: str) -> None:
    steps = 120
    expected = [trajectory(make(robot), seed, steps) for seed in range(6)]
    assert len(set(expected)) == 6
    # A fresh environment, in a process where another user of Bullet changes what belongs to all worlds.
    other = pybullet.connect(pybullet.DIRECT)
    pybullet.setPhysicsEngineParameter(contactBreakingThreshold=0.001, physicsClientId=other)
    fresh = make(robot)
    for seed in range(6):
        assert trajectory(fresh, seed, steps) == expected[seed], f"after {seed} other episodes"
    pybullet.disconnect(physicsClientId=other)
    # Starts in contact with the floor, in the middle of other episodes.
    states = []
    for seed in range(4):
        fresh.reset(seed=100 + seed)
        for action in actions_for(robot, 60, seed):
            fresh.step(action)
        states.append(fresh.get_state())
    new = make(robot)
    for seed, state in enumerate(states * 10):
        ends = []
        # Each start twice in a row, so that the second finds the world as it is a few steps later.
        for environment in (fresh, fresh, new):
            environment.set_state(state)
            for action in actions_for(robot, 1 + seed % 5, seed):
                environment.step(action)
            ends.append(np.hstack(list(environment.get_state().values())).tobytes())
        assert len(set(ends)) == 1, f"start {seed}"
        new.close()
        new = make(robot)


def test_another_process_computes_the_same_bits(make: Make) -> None:
    program = (
        f"import sys, hashlib; sys.path[:0] = [{str(Path(__file__).parent)!r}]\n"
        "from test_roboschool_bullet import *\n"
        "for robot in ROBOTS: print(hashlib.sha256(trajectory(RoboschoolBullet(robot), 3, 60)).hexdigest())"
    )
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert printed.split() == [hashlib.sha256(trajectory(make(robot), 3, 60)).hexdigest() for robot in ROBOTS]


# State.


@pytest.mark.parametrize(("robot", "unlike"), [("ant", 0.0), ("half-cheetah", 0.01), ("walker2d", 0.03)])
def test_a_state_continues_as_where_it_was_taken(make: Make, robot: str, unlike: float) -> None:
    source, copy = make(robot), make(robot)
    joints, feet, bodies = NUMBERS[robot]
    differences = {False: [], True: []}  # whether the floor was touched
    for seed in range(60):
        observation, _ = source.reset(seed=seed)
        for action in actions_for(robot, 25, seed):
            state = source.get_state()
            shown = copy.set_state({name: numbers.tolist() for name, numbers in state.items()} | {"elapsed": 3})
            np.testing.assert_allclose(shown, observation, atol=1e-7)
            for name, numbers in copy.get_state().items():
                np.testing.assert_allclose(numbers, state[name], rtol=0, atol=1e-14, err_msg=name)
            observation, reward, terminated, _, info = source.step(action)
            resumed = copy.step(action)
            touched = state["memory"][1 + feet :].any() or source.get_state()["memory"][1 + feet :].any()
            difference = max(np.abs(resumed[0] - observation).max(), abs(resumed[1] - reward))
            differences[bool(touched)].append(difference)
    lengths = {name: len(numbers) for name, numbers in state.items()}
    root = (7, 6) if robot == "ant" else (3, 3)
    assert lengths == {"positions": root[0] + joints, "velocities": root[1] + joints, "memory": 1 + feet + bodies}
    free, touching = (np.array(differences[touched]) for touched in (False, True))
    share = (touching > TOLERANCE).mean()
    print(f"in the air: {len(free)} steps differ by at most {free.max():.1e}")
    print(f"on the floor: {share:.2%} of {len(touching)} steps differ by more than 1e-6, at most {touching.max():.1e}")
    assert len(free) > 200 and len(touching) > 200
    assert free.max() < TOLERANCE
    # Only points of contact that Bullet remembers are lost.
    assert share <= unlike


def test_positions_and_velocities_mean_what_mujocos_do(make: Make) -> None:
    # Ant looks along +y, flies along +x with 1 m/s and turns about its own x axis with 2 rad/s.
    ant = make("ant", floating=True)
    state = standard_state(ant)
    half = math.sqrt(0.5)
    state["positions"][:7] = [1.0, 2.0, 3.0, half, 0.0, 0.0, half]
    state["velocities"][:6] = [1.0, 0.0, 0.0, 2.0, 0.0, 0.0]
    observation = ant.set_state(state)
    # Height over the reset's 0.75; the target is on the right; so is where it goes; not tilted yet.
    np.testing.assert_allclose(observation[:8], [2.25, -1.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0], atol=3e-3)
    observation = ant.step(np.zeros(8))[0]
    # Legs that were at rest share the turn with the torso: it rolls, but by less than 2 rad/s * 0.0165 s.
    assert 0.01 < observation[6] < 0.034 and abs(observation[7]) < 1e-3, observation[:8]
    place = ant.get_state()["positions"][:3]
    np.testing.assert_allclose(place, [1.0 + CONTROL_STEP, 2.0, 3.0], atol=1e-3)

    # The planar root turns about +y (forwards): HalfCheetah about its torso's centre, Walker2d about the point below.
    for robot, height, lever in (("half-cheetah", 0.7, 0.0), ("walker2d", 1.25, 1.25)):
        environment = make(robot, floating=True)
        state = standard_state(environment)
        state["positions"][:3] = [3.0, 0.5, 0.2]
        observation = environment.set_state(state)
        expected = 0.5 + lever * math.cos(0.2) - lever
        np.testing.assert_allclose([observation[0], observation[7]], [expected, 0.2], atol=1e-6)
        np.testing.assert_allclose(state["memory"][0], height, atol=1e-6)


# Observation and reward.


@pytest.mark.parametrize("robot", ROBOTS)
def test_observations_are_those_worked_out_from_states(make: Make, robot: str) -> None:
    environment = make(robot)
    joints, feet, _ = NUMBERS[robot]
    limits = np.array(LIMITS[robot])
    compared = 0
    for seed in range(10):
        environment.reset(seed=seed)
        for action in actions_for(robot, 40, seed):
            touched = dict(zip(ROBOTS[robot].bodies, environment.get_state()["memory"][1 + feet :], strict=True))
            observation = environment.step(action)[0]
            state = environment.get_state()
            positions, velocities = state["positions"], state["velocities"]
            if robot == "ant":
                height = positions[2]
                w, x, y, z = positions[3:7]
                roll = math.atan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
                pitch = math.asin(2 * (w * y - x * z))
                yaw = math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
                vx, vy, vz = velocities[:3]
            else:
                # Links, of which the torso is one, are seen a sub-step early; its velocity is that of the end.
                lever = 1.25 if robot == "walker2d" else 0.0
                _, rise, turn = positions[:3] - CONTROL_STEP / 4 * velocities[:3]
                if abs(turn) > 1.5:
                    break  # Further on, roll and yaw flip.
                height, roll, pitch, yaw = 0.7 * (lever == 0.0) + rise + lever * math.cos(turn), 0.0, turn, 0.0
                swing, now = velocities[2] * lever, positions[2]
                vx, vy, vz = velocities[0] + swing * math.cos(now), 0.0, velocities[1] - swing * math.sin(now)
            forward, left = vx * math.cos(yaw) + vy * math.sin(yaw), vy * math.cos(yaw) - vx * math.sin(yaw)
            # The target is so far away that its direction is that of +x, to a thousandth.
            expected = [height - state["memory"][0], math.sin(-yaw), math.cos(yaw)]
            expected += [0.3 * forward, 0.3 * left, 0.3 * vz, roll, pitch]
            np.testing.assert_allclose(observation[1:3], expected[1:3], atol=2e-3)
            expected[1:3] = observation[1:3]
            across = (positions[-joints:] - limits.mean(axis=1)) / (limits[:, 1] - limits[:, 0]) * 2
            expected += np.stack([across, 0.1 * velocities[-joints:]], axis=1).ravel().tolist()
            expected += [touched[foot] for foot in ROBOTS[robot].feet]
            np.testing.assert_allclose(observation, np.clip(expected, -5.0, 5.0), rtol=0, atol=1e-6)
            compared += 1
    assert compared > 150


@pytest.mark.parametrize("robot", ROBOTS)
def test_terms_worked_out_from_states_are_the_terms_and_priced_by_hand_the_reward(make: Make, robot: str) -> None:
    environment, dear = make(robot), make(robot, electricity_cost=-3.5)
    joints, feet, _ = NUMBERS[robot]
    limits = np.array(LIMITS[robot])
    middles, halves = limits.mean(axis=1), (limits[:, 1] - limits[:, 0]) / 2
    deaths = 0
    for seed in range(10):
        environment.reset(seed=seed)
        dear.reset(seed=seed)
        for action in 1.5 * actions_for(robot, 40, seed):
            before = environment.get_state()["memory"]
            observation, reward, terminated, truncated, info = environment.step(action)
            terms, state = info["reward_terms"], environment.get_state()
            q, speeds = state["positions"][-joints:], state["velocities"][-joints:]
            assert terms["electricity"] == pytest.approx(np.mean(np.abs(action * 0.1 * speeds)), abs=1e-12)
            assert terms["stall"] == pytest.approx(np.mean(action**2), abs=1e-12)
            at_limit = np.abs(q - middles) / halves
            if np.abs(at_limit - 0.99).min() > 1e-6:
                assert terms["joints_at_limit"] == (at_limit > 0.99).sum()
            height, pitch = observation[0] + before[0], abs(observation[7])
            down = {body for body, flag in zip(ROBOTS[robot].bodies, before[1 + feet :], strict=True) if flag}
            stands = {
                "ant": height > 0.26,
                "half-cheetah": pitch < 1.0 and not down & {"fshin", "fthigh", "bshin", "bthigh"},
                "walker2d": height > 0.8 and pitch < 1.0,
            }[robot]
            assert terms["alive"] == (1.0 if stands else -1.0)
            assert terminated == (not stands) and truncated is False
            assert terms["feet_collision"] == 0.0
            deaths += terminated
            rest = terms["alive"] + terms["progress"] - 0.1 * terms["stall"] - 0.2 * terms["joints_at_limit"]
            assert reward == pytest.approx(rest - 2.0 * terms["electricity"], abs=1e-12)
            _, dear_reward, _, _, dear_info = dear.step(action)
            assert dear_info["reward_terms"] == terms
            assert dear_reward == pytest.approx(rest - 3.5 * terms["electricity"], abs=1e-12)
    assert deaths > 0 or robot == "ant"


def test_progress_is_the_speed_of_the_mean_of_the_links(make: Make) -> None:
    # Without forces all of HalfCheetah moves with 1.2 m/s, which Bullet's drag (below 0.1 / s) hardly slows.
    environment = make("half-cheetah", floating=True)
    state = standard_state(environment)
    state["positions"][-1], state["velocities"][0] = -0.5, 1.2
    environment.set_state(state)
    progress = [environment.step(np.zeros(6))[4]["reward_terms"]["progress"] for _ in range(10)]
    assert 1.18 < progress[9] < progress[0] < 1.2
    # A joint's own motion moves few links: bthigh's swing moves bshin and bfoot, 2 x 2 of the 16 that count.
    state["velocities"][:] = 0.0
    state["velocities"][3] = 1.0
    environment.set_state(state)
    progress = environment.step(np.zeros(6))[4]["reward_terms"]["progress"]
    # They are 0.25 and 0.39 m below it: (2 * -0.25 + 2 * -0.39) / 16 = -0.08 m/s.
    assert progress == pytest.approx(-0.08, abs=1e-3)


def test_torques_are_cut_and_terms_are_not(make: Make) -> None:
    cut, full = make("walker2d"), make("walker2d")
    cut.reset(seed=1)
    full.reset(seed=1)
    seen = [cut.step(np.full(6, 7.0)), full.step(np.full(6, 1.0))]
    assert np.array_equal(seen[0][0], seen[1][0])
    terms = [step[4]["reward_terms"] for step in seen]
    assert terms[0]["stall"] == 49.0 and terms[1]["stall"] == 1.0
    assert terms[0]["electricity"] == pytest.approx(7.0 * terms[1]["electricity"])
    assert terms[0]["progress"] == terms[1]["progress"]


# The interface.
