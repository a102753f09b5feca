"""How `examples/python/roboschool_bullet.py` behaves as an environment, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pybullet
import pytest
from test_roboschool_bullet import NUMBERS, ROBOTS, Make, RoboschoolBullet, make, trajectory  # noqa: F401


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("robot", ROBOTS)
def test_gymnasium_finds_no_fault(make: Make, robot: str) -> None:
    from gymnasium.utils.env_checker import check_env

    environment = make(robot)
    joints, feet, _ = NUMBERS[robot]
    assert environment.observation_space.shape == (8 + 2 * joints + feet,)
    assert environment.action_space == gymnasium.spaces.Box(-1.0, 1.0, (joints,), np.float32)
    assert environment.control_step == 0.0165
    check_env(environment, skip_render_check=True)


def test_a_reset_moves_each_joint_by_a_draw_of_its_own(make: Make) -> None:
    environment = make("walker2d")
    noise = []
    for seed in range(200):
        environment.reset(seed=seed)
        state = environment.get_state()
        assert not state["velocities"].any() and not state["positions"][:3].any()
        noise += state["positions"][3:].tolist()
    # Of a uniform draw from ±0.1 the deviation is 0.0577 and the mean square 0.1²/3.
    assert max(map(abs, noise)) < 0.1 and len(set(noise)) == 1200
    assert abs(np.mean(noise)) < 4 * 0.0577 / math.sqrt(1200)
    assert np.mean(np.square(noise)) == pytest.approx(0.01 / 3, abs=4e-4)
    # Without a seed the draws go on.
    assert not np.array_equal(environment.reset()[0], environment.reset()[0])


def test_bad_arguments_are_refused_by_name(make: Make) -> None:
    with pytest.raises(ValueError, match="robot: expected one of ant, half-cheetah, walker2d, got 'cheetah'"):
        make("cheetah")
    with pytest.raises(ValueError, match="electricity_cost: expected a finite number, got nan"):
        make("ant", electricity_cost=math.nan)
    environment = make("ant")
    for call in (lambda: environment.step(np.zeros(8)), environment.get_state):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset or set_state first"):
            call()
    with pytest.raises(ValueError, match="options: expected none, got speed"):
        environment.reset(options={"speed": 2})


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(7), r"action: expected 8 numbers, got an array of shape \(7,\)"),
        (np.zeros((1, 8)), r"action: expected 8 numbers, got an array of shape \(1, 8\)"),
        ([0.0] * 7 + [math.nan], "action: expected finite numbers, got .*nan"),
        ([math.inf] + [0.0] * 7, "action: expected finite numbers, got .*inf"),
    ],
)
def test_a_bad_action_is_refused_and_does_nothing(make: Make, action: Any, message: str) -> None:
    environment, twin = make("ant"), make("ant")
    environment.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises(ValueError, match=message):
        environment.step(action)
    assert np.array_equal(environment.step(np.ones(8))[0], twin.step(np.ones(8))[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.pop("memory"), r"memory: expected 14 numbers, got an array of shape \(0,\)"),
        (lambda s: s.update(positions=np.zeros(9)), r"positions: expected 15 numbers, got an array of shape \(9,\)"),
        (lambda s: s.update(speed=1), "state: expected positions, velocities, memory, got speed"),
        (lambda s: s["velocities"].__setitem__(3, math.nan), "velocities: expected finite numbers"),
        (lambda s: s["memory"].__setitem__(3, 0.5), "memory: expected flags of 0 or 1"),
        (lambda s: s["positions"].__setitem__(3, 0.9), "positions: expected a unit quaternion"),
    ],
)
def test_a_bad_state_is_refused_and_does_nothing(make: Make, change: Callable[[Any], Any], message: str) -> None:
    environment, twin = make("ant"), make("ant")
    environment.reset(seed=1)
    twin.reset(seed=1)
    state = environment.get_state()
    change(state)
    with pytest.raises(ValueError, match=message):
        environment.set_state(state)
    assert np.array_equal(environment.step(np.ones(8))[0], twin.step(np.ones(8))[0])


def test_a_lost_state_is_told_and_a_reset_cures_it(make: Make) -> None:
    environment = make("half-cheetah")
    environment.reset(seed=1)
    state = environment.get_state()
    state["velocities"][:] = 1e300
    environment.set_state(state)
    with pytest.raises(RuntimeError, match="the simulation is unstable"):
        environment.step(np.zeros(6))
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.step(np.zeros(6))
    assert trajectory(environment, 2, 30) == trajectory(make("half-cheetah"), 2, 30)


def test_worlds_are_given_back(make: Make) -> None:
    forgotten = RoboschoolBullet("walker2d")
    client = forgotten._bullet._client
    assert pybullet.isConnected(physicsClientId=client)
    del forgotten
    assert not pybullet.isConnected(physicsClientId=client)
    environment = make("walker2d")
    environment.reset(seed=1)
    environment.close()
    environment.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.step(np.zeros(6))
