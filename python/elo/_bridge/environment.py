"""Between an environment in Python and the simulator in `backends/src/python/simulator.rs`.

The Rust side makes one `Bridge` for each simulator and calls `reset`, `restore`, `step` and `state`; observation, action
and reward terms pass through arrays that both sides see. Everything that an environment gives is checked here.
"""

from __future__ import annotations

import importlib
import json
import re
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from elo._bridge import BadTarget, find, versions

PARTS = ("positions", "velocities", "memory")
"""What a state is made of."""


def _is_gymnasium_id(target: str) -> bool:
    return re.fullmatch(r".*-v\d+", target) is not None


def _gymnasium() -> Any:
    try:
        return importlib.import_module("gymnasium")
    except ImportError as error:
        raise BadTarget(
            f"Gymnasium is missing in {sys.executable}: `{sys.executable} -m pip install gymnasium`"
        ) from error


def _box(space: Any, what: str) -> Any:
    """The space, which must be a box: other spaces are told how to become one."""
    spaces = _gymnasium().spaces
    if not isinstance(space, spaces.Box):
        raise BadTarget(
            f"its {what} space is {space}, expected a Box; wrap the environment, for instance by "
            "gymnasium.wrappers.FlattenObservation or by one of your own"
        )
    return space


class Bridge:
    """One environment. `action`, `observation` and `terms` are the arrays that both sides see."""

    def __init__(self, config: str) -> None:
        self._config: dict[str, Any] = json.loads(config)
        self._parameters: list[dict[str, Any]] = self._config["task_parameters"]
        self._values = [float(p["default"]) for p in self._parameters]
        self._env = self._make()
        observation_space = _box(self._env.observation_space, "observation")
        action_space = _box(self._env.action_space, "action")
        self._observation_shape = observation_space.shape
        self._action_shape, self._action_dtype = action_space.shape, action_space.dtype
        self._low = np.asarray(action_space.low, np.float32).ravel()
        self._high = np.asarray(action_space.high, np.float32).ravel()
        if not (np.isfinite(self._low).all() and np.isfinite(self._high).all()):
            raise BadTarget(
                f"its action space {action_space} has no bounds; wrap it by gymnasium.wrappers.RescaleAction or clip it"
            )
        self._names = [term["name"] for term in self._config["reward_terms"]]
        self.action = np.zeros(self._low.size, np.float32)
        self.observation = np.zeros(int(np.prod(self._observation_shape)), np.float32)
        self._shown = self.observation.reshape(self._observation_shape)
        self.terms = np.zeros(max(len(self._names), 1), np.float64)
        self._elapsed = 0
        self._sizes: tuple[int, ...] | None = None

    # What it is.

    def describe(self) -> str:
        """Sizes, bounds, time step and versions, as JSON."""
        return json.dumps(
            {
                "observation_size": int(self.observation.size),
                "action_low": [float(x) for x in self._low],
                "action_high": [float(x) for x in self._high],
                "control_step": self._control_step(),
                "versions": versions(type(self._env.unwrapped).__module__, "gymnasium"),
            }
        )

    def _control_step(self) -> float:
        declared = self._config.get("control_step")
        raw = self._env.unwrapped
        rate = (getattr(raw, "metadata", None) or {}).get("render_fps")
        for step in (declared, getattr(raw, "control_step", None), getattr(raw, "dt", None), rate and 1.0 / rate):
            if isinstance(step, (int, float)) and step > 0:
                return float(step)
        return 1.0

    # Making it.

    def _make(self) -> Any:
        target, kwargs = self._config["target"], dict(self._config["kwargs"])
        for parameter, value in zip(self._parameters, self._values, strict=True):
            if parameter["binding"] == "constructor":
                kwargs[parameter["name"]] = value
        if not _is_gymnasium_id(target):
            return find(target, "a Gymnasium id such as `Pendulum-v1`")(**kwargs)
        gymnasium = _gymnasium()
        try:
            # A time limit of its own is taken away: the length of an episode is the caller's.
            return gymnasium.make(target, max_episode_steps=-1, disable_env_checker=True, **kwargs)
        except gymnasium.error.UnregisteredEnv as error:
            raise BadTarget(f"`{target}`: {error}") from error
        except gymnasium.error.DependencyNotInstalled as error:
            raise BadTarget(f"`{target}`: {error}") from error

    # Running it.

    def reset(self, seed: int, values: Sequence[float]) -> None:
        """Begins the episode whose noise comes from `seed`, in the task with these parameters."""
        options = self._take_parameters(values)
        given = self._env.reset(seed=seed % 2**31, options=options or None)
        if not (isinstance(given, tuple) and len(given) == 2):
            raise BadTarget(f"reset gave {type(given).__name__}, expected (observation, info)")
        self._elapsed = 0
        self._see(given[0], "reset")

    def restore(self, state: Mapping[str, Any], elapsed: int, values: Sequence[float]) -> None:
        """Puts the environment into a state that `state` gave, here or in another engine with the same robot."""
        self._take_parameters(values)
        if self._sizes is None:
            self._env.reset(seed=0)
            self._sizes = tuple(len(part) for part in self.state()[:3])
        given = [np.asarray(state[name], np.float64) for name in PARTS]
        if tuple(part.size for part in given) != self._sizes:
            raise BadTarget(
                f"a state of another robot: {', '.join(PARTS)} have {[part.size for part in given]} numbers, expected "
                f"{list(self._sizes)}"
            )
        if not all(np.isfinite(part).all() for part in given):
            raise BadTarget("a state with numbers that are not finite")
        observation = getattr(self._env.unwrapped, self._config["state"]["set"])(state)
        self._elapsed = int(elapsed)
        self._see(observation, self._config["state"]["set"])

    def state(self) -> tuple[list[float], list[float], list[float], int]:
        """Positions, velocities, memory, and control steps since the reset."""
        state = getattr(self._env.unwrapped, self._config["state"]["get"])()
        if not isinstance(state, Mapping):
            state = {"positions": state}
        parts = [np.asarray(state.get(name, ()), np.float64).ravel().tolist() for name in PARTS]
        return parts[0], parts[1], parts[2], self._elapsed

    def step(self) -> int:
        """Takes `action`; 0 while the episode goes on, 1 when it terminated, 2 when it was truncated."""
        # An engine leaves nothing of this in the processor's caches, so each lookup counts.
        given = self._env.step(self.action.astype(self._action_dtype).reshape(self._action_shape))
        if type(given) is not tuple or len(given) != 5:
            raise BadTarget(
                "step must give (observation, reward, terminated, truncated, info); this is Gymnasium's interface since "
                f"0.26, got {type(given).__name__}" + (f" of {len(given)}" if isinstance(given, tuple) else "")
            )
        observation, reward, terminated, truncated, info = given
        self._elapsed += 1
        self._see(observation, "step")
        if type(reward) is float and not self._names:
            self.terms[0] = reward
        else:
            self._price(reward, info)
        return 1 if terminated else 2 if truncated else 0

    def _take_parameters(self, values: Sequence[float]) -> dict[str, float]:
        """Tells the environment the task's parameters; those that go with a reset are returned."""
        changed = [float(v) for v in values]
        constructed = [p["binding"] == "constructor" for p in self._parameters]
        anew = any(c and a != b for c, a, b in zip(constructed, changed, self._values, strict=True))
        self._values = changed
        if anew:
            self._env.close()
            self._env = self._make()
        options = {}
        for parameter, value in zip(self._parameters, changed, strict=True):
            if parameter["binding"] == "attribute":
                raw = self._env.unwrapped
                if not hasattr(raw, parameter["name"]):
                    raise BadTarget(f"{type(raw).__name__} has no attribute `{parameter['name']}`")
                setattr(raw, parameter["name"], value)
            elif parameter["binding"] == "option":
                options[parameter["name"]] = value
        return options

    def _see(self, observation: Any, where: str) -> None:
        array = observation if type(observation) is np.ndarray else np.asarray(observation)
        if array.shape != self._observation_shape:
            raise BadTarget(
                f"{where} gave an observation of shape {array.shape}, its space says {self._observation_shape}"
            )
        if array.dtype.kind not in "fiub":
            raise BadTarget(f"{where} gave an observation of {array.dtype}, expected numbers")
        self._shown[...] = array

    def _price(self, reward: Any, info: Any) -> None:
        if not self._names:
            if not isinstance(reward, (int, float, np.number)) and not (
                isinstance(reward, np.ndarray) and reward.ndim == 0
            ):
                raise BadTarget(f"step gave the reward {reward!r}, expected a number")
            self.terms[0] = reward
            return
        terms = info.get("reward_terms", info)
        for index, name in enumerate(self._names):
            if name not in terms:
                raise BadTarget(f"step's info has no reward term `{name}`; it has {', '.join(map(str, terms))}")
            self.terms[index] = terms[name]
