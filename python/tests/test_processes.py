"""The package in several processes, and what an interpreter survives."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import elo.gym
import gymnasium
import numpy as np
import pytest
from conftest import ENVIRONMENTS

RAPIER = {"kind": "rapier", "robot": "half-cheetah"}


def made() -> gymnasium.Env:
    return elo.gym.make(RAPIER)


@pytest.mark.parametrize("start", ["fork", "spawn", "forkserver"])
def test_environments_in_other_processes_do_what_they_do_here(start: str) -> None:
    here = gymnasium.vector.SyncVectorEnv([made] * 2)
    there = gymnasium.vector.AsyncVectorEnv([made] * 2, context=start)
    try:
        for environments in (here, there):
            environments.action_space.seed(1)
        seen = [environments.reset(seed=3)[0] for environments in (here, there)]
        assert np.array_equal(*seen)
        for _ in range(5):
            action = here.action_space.sample()
            (first, gained, *_), (second, earned, *_) = here.step(action), there.step(action)
            assert np.array_equal(first, second) and np.array_equal(gained, earned)
    finally:
        there.close()


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)


def test_an_interpreter_ends_with_environments_and_threads_alive() -> None:
    ended = run(
        "import threading, time, elo.gym\n"
        f"environment = elo.gym.make({RAPIER})\n"
        "environment.reset(seed=1)\n"
        "threading.Thread(target=time.sleep, args=(3600,), daemon=True).start()\n"
    )
    assert ended.returncode == 0, ended.stderr


def test_what_is_wrong_raises_and_the_interpreter_goes_on() -> None:
    environment = elo.gym.make(RAPIER)
    with pytest.raises(RuntimeError, match="call reset first"):
        environment.unwrapped.step(np.zeros(6, np.float32))
    environment.reset(seed=1)
    with pytest.raises(RuntimeError, match="action component 0"):
        environment.unwrapped.step(np.full(6, np.nan, np.float32))
    with pytest.raises(RuntimeError, match="has 5 numbers, expected 6"):
        environment.reset(seed=1)
        environment.unwrapped.step(np.zeros(5, np.float32))
    # An environment belongs to the thread that made it; another thread is told, and nothing is lost.
    ended = run(
        "import threading, elo.gym\n"
        f"environment = elo.gym.Environment({RAPIER})\n"
        "other = threading.Thread(target=lambda: environment.reset(seed=1))\n"
        "other.start(); other.join()\n"
        "print(environment.reset(seed=1)[0].shape)\n"
    )
    assert "(26,)" in ended.stdout and "another thread" in ended.stderr, ended.stderr


def test_control_c_ends_a_program_that_steps() -> None:
    program = (
        # Whoever runs the tests in the background of a shell has them ignore it.
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import elo.gym\n"
        f"environment = elo.gym.make({RAPIER}, max_episode_steps=None)\n"
        "environment.reset(seed=1)\n"
        "print('begun', flush=True)\n"
        "while True:\n"
        "    if environment.step(environment.action_space.sample())[2]:\n"
        "        environment.reset()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=20)
    assert "KeyboardInterrupt" in told and process.returncode != 0


INTERRUPTED = f"""
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {str(ENVIRONMENTS)!r})
import elo.conformance, elo.gym, habits
def table(how):
    return {{"kind": "python", "target": "habits:Interrupted", "kwargs": {{"how": how}}, "reward_floor": -10.0}}
mass = {{"kind": "python", "target": "toys:Mass", "reward_floor": -10.0}}
def steps(how):
    environment = elo.gym.make(table(how), max_episode_steps=None)
    environment.reset(seed=1)
    for _ in range(5):
        environment.step(environment.action_space.sample())
"""


@pytest.mark.parametrize(
    ("call", "raised"),
    [
        ("steps('ctrl-c')", "KeyboardInterrupt"),
        ("steps('exit')", "SystemExit"),
        ("elo.conformance.simulator(table('ctrl-c'))", "KeyboardInterrupt"),
        ("elo.conformance.simulator(table('exit'))", "SystemExit"),
        ("elo.conformance.teacher({'kind': 'python', 'target': 'habits:interrupted_teacher'}, mass)", "KeyboardInterrupt"),
        ("elo.conformance.metric({'kind': 'python', 'target': 'habits:interrupted_score'})", "KeyboardInterrupt"),
    ],
)
def test_control_c_in_python_that_elo_calls_passes_through_it(call: str, raised: str) -> None:
    program = (
        f"{INTERRUPTED}\n"
        f"try:\n    {call}\n"
        "except BaseException as error:\n    print(type(error).__name__, habits.Interrupted.steps, error)\n"
        "else:\n    print('went on')\n"
        # What was stopped can be done again.
        "print(elo.conformance.simulator(mass))\n"
    )
    ended = run(program)
    lines = ended.stdout.splitlines()
    assert lines[0].split()[0] == raised and lines[-1] == "[]", (ended.stdout, ended.stderr)
    # Nothing was asked of the environment after the third step. A metric's rule on threads goes on to its end.
    assert "metric" in call or lines[0].split()[1] in ("0", "3"), ended.stdout
    assert raised == "KeyboardInterrupt" or lines[0].endswith("7")
