"""A point mass for tests, and others that go wrong in one way each."""

from __future__ import annotations

import ctypes
import os
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np


class Mass(gymnasium.Env[Any, Any]):
    """Pushed along a line towards 1; `goal` is an attribute, `weight` a keyword, `effort` is priced."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    control_step = 0.05

    def __init__(self, weight: float = 1.0) -> None:
        self.weight, self.goal = weight, 1.0
        self.place = self.speed = 0.0

    def _see(self) -> Any:
        return np.array([self.place, self.speed], np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.place, self.speed = float(self.np_random.uniform(-0.5, 0.5)), 0.0
        return self._see(), {}

    def step(self, action: Any) -> Any:
        force = float(action[0])
        self.speed += 0.05 * force / self.weight
        self.place += 0.05 * self.speed
        terms = {"nearness": -abs(self.goal - self.place), "effort": force * force}
        return self._see(), terms["nearness"], abs(self.place) > 3.0, False, {"reward_terms": terms}

    def get_state(self) -> Any:
        return {"positions": [self.place], "velocities": [self.speed], "memory": []}

    def set_state(self, state: Any) -> Any:
        self.place, self.speed = float(state["positions"][0]), float(state["velocities"][0])
        return self._see()


class Wrong(Mass):
    """Goes wrong in the way called `how` once the mass is beyond `at`, if `marker` is not there yet (it is then made)."""

    def __init__(self, how: str, at: float = 0.3, marker: str = "") -> None:
        super().__init__()
        self.how, self.at, self.marker = how, at, Path(marker) if marker else None
        if how == "dict":
            self.observation_space = gymnasium.spaces.Dict({"place": Mass.observation_space})  # type: ignore[assignment]
        if how == "discrete":
            self.action_space = gymnasium.spaces.Discrete(3)  # type: ignore[assignment]

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        observation, info = super().reset(seed=seed, options=options)
        return observation * (np.nan if self.how == "nan at reset" else 1.0), info

    def get_state(self) -> Any:
        if self.how == "sleeps when asked":
            time.sleep(1000)
        return super().get_state()

    def set_state(self, state: Any) -> Any:
        return super().set_state(state) * (np.nan if self.how == "nan when set" else 1.0)

    def step(self, action: Any) -> Any:
        observation, reward, terminated, truncated, info = super().step(action)
        if self.how == "hidden counter":
            self.at += 0.01
            return observation + np.float32(self.at), reward, terminated, truncated, info
        if abs(self.place) < self.at or (self.marker and self.marker.exists()):
            return observation, reward, terminated, truncated, info
        if self.marker:
            self.marker.touch()
        if self.how == "raises":
            raise RuntimeError("the motor is on fire")
        if self.how == "hangs":
            while True:
                pass
        if self.how == "sleeps":
            time.sleep(1000)
        if self.how == "exits":
            os._exit(0)
        if self.how == "aborts":
            os.abort()
        if self.how == "segfaults":
            ctypes.string_at(0)
        if self.how == "nan":
            observation[0] = np.nan
        if self.how == "shape":
            observation = np.zeros(3, np.float32)
        if self.how == "text":
            observation = np.array(["a", "b"])
        if self.how == "four":
            return observation, reward, terminated, info
        if self.how == "no reward":
            reward = None
        if self.how == "no term":
            info["reward_terms"]["effort"] = None
        if self.how == "nan term":
            info["reward_terms"]["effort"] = np.float32(np.nan)
        if self.how == "nan reward":
            reward = np.nan
        if self.how == "complex reward":
            reward = np.complex64(1.0)
        if self.how == "no info":
            info = None
        if self.how == "list of terms":
            info["reward_terms"] = [1.0, 2.0]
        if self.how == "unsaid end":
            terminated = None
        if self.how == "end in words":
            terminated, truncated = True, "no"
        return observation, reward, terminated, truncated, info


class Band(Mass):
    """Crashes in the 15th step after a reset between 0.40 and 0.42."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        seen = super().reset(seed=seed, options=options)
        self.steps, self.doomed = 0, 0.40 < self.place < 0.42
        return seen

    def step(self, action: Any) -> Any:
        self.steps += 1
        if self.doomed and self.steps == 15:
            os.abort()
        return super().step(action)


class Asked(Mass):
    """Its goal goes with a reset; without one it is 1."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        self.goal = (options or {}).get("goal", 1.0)
        return super().reset(seed=seed, options=options)


class Fragile(Mass):
    """Cannot be made heavier than 1.5, and cannot be used once it is closed."""

    def __init__(self, weight: float = 1.0) -> None:
        if weight > 1.5:
            raise RuntimeError("the mass is too heavy")
        super().__init__(weight)
        self.closed = False

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        assert not self.closed
        return super().reset(seed=seed, options=options)

    def close(self) -> None:
        self.closed = True


class Heavy(Mass):
    """The first that is made with another weight takes its time, if `marker` is not there yet."""

    def __init__(self, marker: str, weight: float = 1.0) -> None:
        super().__init__(weight)
        if weight != 1.0 and not Path(marker).exists():
            Path(marker).touch()
            time.sleep(2.5)


class Row(Mass):
    """Its state is one array."""

    def get_state(self) -> Any:
        return np.array([[self.place, self.speed]])

    def set_state(self, state: Any) -> Any:
        assert isinstance(state, np.ndarray) and state.shape == (1, 2), state
        self.place, self.speed = state[0].tolist()
        return self._see()


class Strict(Mass):
    """Takes actions of 64 bits, in a row of rows, and none beyond its bounds, which numbers of 32 bits cannot tell."""

    action_space = gymnasium.spaces.Box(-0.1, 0.1, (1, 1), np.float64)  # type: ignore[assignment]

    def step(self, action: Any) -> Any:
        assert self.action_space.contains(action), f"{action!r} is not in {self.action_space}"
        return super().step(action[0])


class Single(Mass):
    """Gives all that it gives as NumPy's own numbers, its time step too. It ends at once."""

    control_step = None  # type: ignore[assignment]
    dt = np.float32(0.05)

    def step(self, action: Any) -> Any:
        observation, reward, _, _, info = super().step(action)
        terms = {name: np.float32(term) for name, term in info["reward_terms"].items()}
        return observation, np.float32(reward), np.bool_(True), np.False_, {"reward_terms": terms}


class Noted(Strict):
    """Notes in a file, a line each, when one is opened and when it is closed."""

    def __init__(self, diary: str, weight: float = 1.0) -> None:
        super().__init__(weight)
        self.diary = Path(diary)
        self._note("opened")

    def _note(self, what: str) -> None:
        with open(self.diary, "a") as file:
            file.write(f"{what}\n")

    def close(self) -> None:
        self._note("closed")


class Away(Mass):
    """Goes wrong in the way called `how` in every process but `home`."""

    def __init__(self, home: int, how: str) -> None:
        super().__init__()
        self.how = how if os.getpid() != home else ""
        if self.how == "is not made":
            raise RuntimeError("the port is taken")
        if self.how == "sees more":
            self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)

    def _see(self) -> Any:
        seen = super()._see()
        return np.append(seen, np.float32(0.0)) if self.how == "sees more" else seen

    def step(self, action: Any) -> Any:
        print("a step")
        observation, reward, terminated, truncated, info = super().step(action)
        if self.how == "shows its process":
            observation[1] += os.getpid()
        if self.how == "pays a little more":
            reward = np.nextafter(reward, 1.0)
        if self.how == "ends":
            terminated = True
        if self.how == "exits":
            os._exit(3)
        if self.how == "aborts":
            os.abort()
        return observation, reward, terminated, truncated, info


class Doubled(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Shows twice what there is."""

    def observation(self, observation: Any) -> Any:
        return 2.0 * observation


class Cut(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Shows the place alone, without a method that says so."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float32)


def doubled() -> Any:
    """A wrapped mass."""
    return Doubled(Mass())


def cut() -> Any:
    """A mass in a wrapper through which a state cannot be seen."""
    return Cut(Mass())


def boxed() -> Any:
    """One whose package is missing, as Gymnasium tells it."""
    raise gymnasium.error.DependencyNotInstalled('Boxes are missing: `pip install "gymnasium[boxes]"`')


gymnasium.register("Mass-v0", Mass, max_episode_steps=5)
gymnasium.register("Boxed-v0", boxed)


def controller(task: dict[str, float], seed: int, gain: float = 2.0, how: str = "") -> Any:
    """A teacher of `Mass`: pushes towards the task's goal. Goes wrong in the way called `how`."""
    if how == "no policy":
        return 3

    def act(observation: Any, noise: np.random.Generator | None) -> Any:
        if how == "raises" and abs(observation[0]) > 0.01:
            raise RuntimeError("the teacher has gone home")
        force = gain * (task.get("goal", 1.0) - observation[0]) - gain * observation[1]
        if noise is not None:
            force += 0.1 * noise.standard_normal()
        action = np.clip([force], -1.0, 1.0)
        return {"two actions": np.zeros(2), "text": np.array(["left"]), "nan": action * np.nan}.get(how, action)

    return act


def replayer(task: dict[str, float], seed: int, weights: str) -> Any:
    """A teacher of any robot, from a file: actions are `weights` times the observation."""
    matrix = np.load(weights)
    return lambda observation, noise: np.tanh(matrix @ observation)


def cvar(returns: Any, mean: float, standard_deviation: float, share: float = 0.5, how: str = "") -> Any:
    """The mean of the worst returns. Goes wrong in the way called `how`."""
    assert returns.ndim == 2 and np.isfinite([mean, standard_deviation]).all()
    if how == "raises":
        raise RuntimeError("nothing is good enough")
    count = max(1, int(share * returns.shape[1]))
    scores = np.sort(returns, axis=1)[:, :count].mean(axis=1)
    return {"one number": scores.sum(), "text": scores.astype(str), "nan": scores * np.nan}.get(how, scores)
