"""Between an environment in Python and the simulator in `backends/src/python/simulator.rs`.

The Rust side makes one `Bridge` for each simulator and calls `prepare`, `reset`, `restore`, `step` and `state`; observation, action
and reward terms pass through arrays that both sides see. Everything that an environment gives is checked here, but for
whether the numbers of its observations are finite: that is checked once, where they are taken over.
"""

from __future__ import annotations

import contextlib
import copy
import importlib
import json
import numbers
import re
import sys
import weakref
from collections.abc import Callable, Mapping, Sequence
from math import inf, isfinite
from typing import Any

import numpy as np

from elo._bridge import BadTarget, find, hashes, imported, origins, versions
from elo._bridge.states import States, layers

MAKES = ("id", "max_episode_steps", "disable_env_checker")
"""Arguments of `gymnasium.make` that are given here."""


def _is_gymnasium_id(target: str) -> bool:
    return re.fullmatch(r".*-v\d+", target) is not None


def _gymnasium() -> Any:
    try:
        return importlib.import_module("gymnasium")
    except ImportError as error:
        raise BadTarget(
            f"Gymnasium is missing in {sys.executable}: `{sys.executable} -m pip install gymnasium`"
        ) from error


def _made(target: str, kwargs: dict[str, Any]) -> Any:
    """An environment of Gymnasium's registry, without the wrappers that cost time or end episodes."""
    for name in MAKES:
        if name in kwargs:
            raise BadTarget(
                f"`kwargs` of `{target}` name `{name}`, which elo gives: how long an episode lasts is up to whoever runs it, "
                "and has fields of its own in the config"
            )
    gymnasium = _gymnasium()
    module, _, name = target.rpartition(":")
    if module:
        imported(module, target)
    try:
        spec = copy.deepcopy(gymnasium.spec(name))
    except gymnasium.error.Error as error:
        raise BadTarget(f"`{target}`: {error}") from error
    # Episodes begin with a reset or with a state that is set, which that wrapper does not know.
    spec.order_enforce = False
    try:
        return gymnasium.make(spec, max_episode_steps=-1, disable_env_checker=True, **kwargs)
    except gymnasium.error.DependencyNotInstalled as error:
        raise BadTarget(f"`{target}`: {error}") from error


BOXES = {
    "observation": "gymnasium.wrappers.FlattenObservation or by a gymnasium.ObservationWrapper of your own",
    "action": "a gymnasium.ActionWrapper of your own that makes its actions of those of a Box",
}
"""What gives an environment a space that is a box."""


def _box(space: Any, what: str) -> Any:
    """The space, which must be a box: other spaces are told how to become one. `what` is one of `BOXES`."""
    spaces = _gymnasium().spaces
    if not isinstance(space, spaces.Box):
        raise BadTarget(f"its {what} space is {space}, expected a Box; wrap the environment by {BOXES[what]}")
    return space


def _number(value: Any, what: str) -> float:
    """The value, which must be one finite number."""
    scalar = isinstance(value, (numbers.Real, np.bool_))
    if scalar or (isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "fiub"):
        number = float(value)
        if isfinite(number):
            return number
        raise BadTarget(f"step gave {what} {number}, which is not finite")
    raise BadTarget(f"step gave {what} {value!r}, expected a number")


def _truth(value: Any, what: str) -> bool:
    """The value, which must be true or false: what is merely empty or not, such as a text, is most likely a mistake."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise BadTarget(f"step gave `{what}` {value!r}, expected True or False")


def _positive(value: Any) -> float | None:
    """The value, if it is a number that can be a time step or a rate."""
    able = isinstance(value, numbers.Real) and not isinstance(value, bool)
    number = float(value) if able else 0.0
    return number if 0.0 < number < inf else None


class Bridge:
    """One environment. `action`, `observation` and `terms` are the arrays that both sides see.

    What a step gives is mostly of Python's own types, which pass without a further call: beside a small environment it would count.

    The environment is closed as soon as nothing refers to the bridge, and else when the interpreter ends. So nothing in here may
    refer to the bridge in a circle.
    """

    def __init__(self, config: str) -> None:
        self._config: dict[str, Any] = json.loads(config)
        self._parameters: list[dict[str, Any]] = self._config["task_parameters"]
        # Left out where there are none.
        self._files: dict[str, str] = self._config.get("files", {})
        self._values = [float(p["default"]) for p in self._parameters]
        self._options: dict[str, float] = {}
        self._adopt(self._make(self._values))
        observation_space = _box(self._env.observation_space, "observation")
        action_space = _box(self._env.action_space, "action")
        self._observation_shape = observation_space.shape
        self._low = np.asarray(action_space.low, np.float32).ravel()
        self._high = np.asarray(action_space.high, np.float32).ravel()
        if not (np.isfinite(self._low).all() and np.isfinite(self._high).all()):
            raise BadTarget(
                f"its action space {action_space} has no bounds; wrap it by gymnasium.wrappers.RescaleAction or clip it"
            )
        self._names = [term["name"] for term in self._config["reward_terms"]]
        self.action = np.zeros(self._low.size, np.float32)
        self._given = self._handing(action_space)
        self.observation = np.zeros(int(np.prod(self._observation_shape)), np.float32)
        self._shown = self.observation.reshape(self._observation_shape)
        self.terms = np.zeros(max(len(self._names), 1), np.float64)
        self._elapsed = 0

    def _handing(self, space: Any) -> Callable[[], Any]:
        """What gives the action as the space has it: an array that an environment may keep or change."""
        action, shape, dtype, low, high = self.action, space.shape, space.dtype, space.low, space.high
        if dtype == np.float32 and len(shape) == 1:
            return action.copy
        # The bounds that the other side keeps to are rounded to float32, which may lie beyond those of the space.
        return lambda: np.clip(action.astype(dtype).reshape(shape), low, high)

    # What it is.

    def describe(self) -> str:
        """Sizes, bounds, time step and versions, as JSON."""
        return json.dumps(
            {
                "observation_size": int(self.observation.size),
                "action_low": [float(x) for x in self._low],
                "action_high": [float(x) for x in self._high],
                "control_step": self._control_step(),
                "versions": self._versions(),
            }
        )

    def _versions(self) -> str:
        target = self._config["target"]
        maker = [] if _is_gymnasium_id(target) else [find(target)]
        modules = origins(target, *maker, *layers(self._env))
        found = versions([type(self._env.unwrapped).__module__, *modules], "gymnasium")
        return ", ".join([found, *hashes(self._files)])

    def _control_step(self) -> float:
        declared = self._config.get("control_step")
        raw = self._env.unwrapped
        rate = _positive((getattr(raw, "metadata", None) or {}).get("render_fps"))
        steps = map(_positive, (declared, getattr(raw, "control_step", None), getattr(raw, "dt", None)))
        return next((step for step in steps if step), 1.0 / rate if rate else 1.0)

    # Making it.

    def _make(self, values: Sequence[float]) -> Any:
        target, kwargs = self._config["target"], {**self._files, **self._config["kwargs"]}
        for parameter, value in zip(self._parameters, values, strict=True):
            if parameter["binding"] == "constructor":
                kwargs[parameter["name"]] = value
        if _is_gymnasium_id(target):
            return _made(target, kwargs)
        return find(target, "a Gymnasium id such as `Pendulum-v1`")(**kwargs)

    def _adopt(self, env: Any) -> None:
        methods = self._config.get("state")
        self._states = States(env, methods["get"], methods["set"]) if methods else None
        # An engine leaves nothing of this in the processor's caches, so each lookup counts.
        self._env, self._env_reset, self._env_step = env, env.reset, env.step
        self._closing = weakref.finalize(self, env.close)
        self._fresh = True

    def prepare(self, values: Sequence[float]) -> None:
        """Tells the environment the task's parameters, those of the next reset or state. This may make it anew."""
        if not self._parameters:
            return
        changed = [float(v) for v in values]
        pairs = zip(self._parameters, changed, self._values, strict=True)
        if any(p["binding"] == "constructor" and new != old for p, new, old in pairs):
            # The old one goes on as it was when the new one cannot be made.
            close = self._closing
            self._adopt(self._make(changed))
            self._values = changed
            # As where Rust closes one: its errors are nobody's.
            with contextlib.suppress(Exception):
                close()
        self._values = changed
        self._set_attributes()
        bound = zip(self._parameters, changed, strict=True)
        self._options = {p["name"]: value for p, value in bound if p["binding"] == "option"}

    def close(self) -> None:
        """Closes the environment, which cannot be used any more. Does nothing when it is closed already."""
        self._closing()

    def _set_attributes(self) -> None:
        raw = self._env.unwrapped
        for parameter, value in zip(self._parameters, self._values, strict=True):
            if parameter["binding"] == "attribute":
                if not hasattr(raw, parameter["name"]):
                    raise BadTarget(f"{type(raw).__name__} has no attribute `{parameter['name']}`")
                setattr(raw, parameter["name"], value)

    # Running it.

    def reset(self, seed: int) -> None:
        """Begins the episode whose noise comes from `seed`."""
        self._see(self._begin(seed), "reset")
        self._elapsed = 0

    def restore(self, state: Mapping[str, Any], elapsed: int) -> None:
        """Puts the environment into a state that `state` gave, here or in another engine with the same robot."""
        if self._options or self._fresh:
            self._begin(0)
        states = self._settable()
        self._see(states.set(state), states.setter)
        self._elapsed = int(elapsed)

    def state(self) -> tuple[list[float], list[float], list[float], int]:
        """Positions, velocities, memory, and control steps since the reset."""
        positions, velocities, memory = self._settable().get()
        return positions, velocities, memory, self._elapsed

    def _settable(self) -> States:
        if self._states is None:
            raise BadTarget("the config names no `state` methods")
        return self._states

    def _begin(self, seed: int) -> Any:
        given = self._env_reset(seed=seed % 2**31, options=dict(self._options) or None)
        if not (isinstance(given, tuple) and len(given) == 2):
            raise BadTarget(f"reset gave {type(given).__name__}, expected (observation, info)")
        self._fresh = False
        return given[0]

    def step(self) -> int:
        """Takes `action`; 0 while the episode goes on, 1 when it terminated, 2 when it was truncated."""
        given = self._env_step(self._given())
        if type(given) is not tuple or len(given) != 5:
            raise BadTarget(
                "step must give (observation, reward, terminated, truncated, info); this is Gymnasium's interface since "
                f"0.26, got {type(given).__name__}" + (f" of {len(given)}" if isinstance(given, tuple) else "")
            )
        observation, reward, terminated, truncated, info = given
        self._elapsed += 1
        self._see(observation, "step")
        if self._names:
            self._price(info)
        else:
            self.terms[0] = reward if type(reward) is float and isfinite(reward) else _number(reward, "the reward")
        if type(terminated) is not bool or type(truncated) is not bool:
            terminated, truncated = _truth(terminated, "terminated"), _truth(truncated, "truncated")
        return 1 if terminated else 2 if truncated else 0

    def _see(self, observation: Any, where: str) -> None:
        array = observation if type(observation) is np.ndarray else np.asarray(observation)
        if array.shape != self._observation_shape:
            raise BadTarget(
                f"{where} gave an observation of shape {array.shape}, its space says {self._observation_shape}"
            )
        if array.dtype.kind not in "fiub":
            raise BadTarget(f"{where} gave an observation of {array.dtype}, expected numbers")
        self._shown[...] = array

    def _price(self, info: Any) -> None:
        if not isinstance(info, (dict, Mapping)):
            raise BadTarget(f"step gave `info` {info!r}, expected a mapping with the reward terms that the config names")
        terms = info.get("reward_terms", info)
        if not isinstance(terms, (dict, Mapping)):
            raise BadTarget(f"step gave `info[\"reward_terms\"]` {terms!r}, expected a mapping of names to numbers")
        for index, name in enumerate(self._names):
            if name not in terms:
                found = ", ".join(map(str, terms)) or "nothing"
                raise BadTarget(f"step's info has no reward term `{name}`; it has {found}")
            term = terms[name]
            fine = type(term) is float and isfinite(term)
            self.terms[index] = term if fine else _number(term, f"the reward term `{name}`")
