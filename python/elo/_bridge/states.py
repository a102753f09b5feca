"""Reading and setting the state of an environment, below its wrappers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from elo._bridge import BadTarget

PARTS = ("positions", "velocities", "memory")
"""What a state is made of."""


def layers(env: Any, last: Any = None) -> Iterator[Any]:
    """An environment and what it wraps, from the outside, as far as `last`."""
    seen: set[int] = set()
    while env is not None and id(env) not in seen:
        seen.add(id(env))
        yield env
        env = None if env is last else getattr(env, "env", None)


class States:
    """The outermost layer of `env` that has the methods `getter` and `setter`, and the wrappers around it."""

    def __init__(self, env: Any, getter: str, setter: str) -> None:
        around: list[Any] = []
        for layer in layers(env, env.unwrapped):
            get, set = getattr(layer, getter, None), getattr(layer, setter, None)
            if callable(get) and callable(set):
                self._get, self._set = get, set
                break
            around.append(layer)
        else:
            name = type(env.unwrapped).__name__
            raise BadTarget(f"{name} has no methods `{getter}` and `{setter}`, which the config names in `state`")
        self._see = [see for wrapper in reversed(around) for see in _view(wrapper)]
        self.setter, self._plain = setter, False
        self._shapes: list[tuple[int, ...]] = []

    def get(self) -> list[list[float]]:
        """The numbers of each of `PARTS`."""
        given = self._get()
        plain = not isinstance(given, Mapping)
        parts = [np.asarray(part, np.float64) for part in ([given, (), ()] if plain else [given.get(p, ()) for p in PARTS])]
        if not self._shapes:
            self._plain, self._shapes = plain, [part.shape for part in parts]
        return [part.ravel().tolist() for part in parts]

    def set(self, state: Mapping[str, Any]) -> Any:
        """Sets the state to these `PARTS`, in the form in which it is given; the observation there."""
        if not self._shapes:
            self.get()
        given = [np.asarray(state[name], np.float64) for name in PARTS]
        sizes = [int(np.prod(shape)) for shape in self._shapes]
        if [part.size for part in given] != sizes:
            raise BadTarget(
                f"a state of another robot: {', '.join(PARTS)} have {[part.size for part in given]} numbers, expected {sizes}"
            )
        if not all(np.isfinite(part).all() for part in given):
            raise BadTarget("a state with numbers that are not finite")
        shaped = [part.reshape(shape) for part, shape in zip(given, self._shapes, strict=True)]
        observation = self._set(shaped[0] if self._plain else dict(zip(PARTS, shaped, strict=True)))
        for see in self._see:
            observation = see(observation)
        return observation


def _view(wrapper: Any) -> list[Callable[[Any], Any]]:
    """How a wrapper changes an observation: by its method `observation`, or not at all."""
    if callable(getattr(wrapper, "observation", None)):
        return [wrapper.observation]
    if wrapper.observation_space == wrapper.env.observation_space:
        return []
    raise BadTarget(
        f"{type(wrapper).__name__} changes observations and has no method `observation`, so that nobody can tell what is seen in "
        "a state that was set below it; give it one, or the methods that `state` names"
    )
