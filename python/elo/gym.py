"""This project's robots as Gymnasium environments, and environments whose actions are options."""

from __future__ import annotations

import json
import numbers
import operator
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from elo import _elo
from elo._options import OptionSet

Array = npt.NDArray[np.float32]
Step = tuple[Array, float, bool, bool, dict[str, Any]]

RESET_OPTIONS = ("task", "state")
"""What `Environment.reset` takes as options."""


class Environment(gymnasium.Env[Array, Array]):
    """One of the simulators that configs name, e.g. `{"kind": "rapier", "robot": "ant"}`.

    `reset(options={"task": {...}})` sets the task's parameters, `reset(options={"state": ...})` begins in a state that
    `state()` gave, with lists or arrays. `info["reward_terms"]` holds the unpriced terms of the reward. There is no time limit.

    A reset without these options is one to the task that the environment was made with. So is the one with which a vector
    environment goes on by itself after an end. Paths in the config, such as that of a robot's MJCF file, are relative to the working
    directory. Copies and pickles hold config and task: they begin with a reset.

    `close()` ends the simulator, and closes the environment of one's own that it is made of, if it is: `with make(config) as env`
    does so at its end. Afterwards a reset, a step and the state raise gymnasium.error.ClosedEnvironmentError.
    """

    def __init__(self, config: Mapping[str, Any], task: Mapping[str, float] | None = None) -> None:
        if not isinstance(config, Mapping):
            raise TypeError(f"expected a `[simulator]` table, such as {{'kind': 'rapier', 'robot': 'ant'}}, got {config!r}")
        self._config = _json(config)
        self._opened: _elo.Simulator | None = _elo.Simulator(self._config)
        self.elo_spec: dict[str, Any] = json.loads(self._simulator.spec())
        self._terms = [term["name"] for term in self.elo_spec["reward_terms"]]
        self._default_task = dict(task or {})
        self._set_task(self._default_task)
        self.control_step = float(self.elo_spec["control_step"])
        self.metadata = {"render_modes": [], "render_fps": round(1.0 / self.control_step)}
        self.observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, (self.elo_spec["observation_size"],), np.float32
        )
        self.action_space = gymnasium.spaces.Box(
            np.asarray(self.elo_spec["action_low"], np.float32), np.asarray(self.elo_spec["action_high"], np.float32)
        )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_opened"}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__.update(state)
        self._opened = _elo.Simulator(self._config)

    @property
    def _simulator(self) -> _elo.Simulator:
        if self._opened is None:
            raise gymnasium.error.ClosedEnvironmentError("the environment is closed; make another one")
        return self._opened

    def _set_task(self, task: Mapping[str, float]) -> None:
        text = _json(task)
        self._prices = np.asarray(self._simulator.prices(text))
        self._task = text

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        options = options or {}
        unknown = sorted(set(options) - set(RESET_OPTIONS))
        if unknown:
            raise ValueError(f"reset has no option `{unknown[0]}`; expected one of {', '.join(RESET_OPTIONS)}")
        super().reset(seed=seed)
        self._set_task(options.get("task", self._default_task))
        start = {"state": options["state"]} if "state" in options else {"seed": int(self.np_random.integers(2**63))}
        return self._simulator.reset(self._task, _json(start)), {}

    def step(self, action: Array) -> Step:
        observation, terms, terminated, truncated = self._simulator.step(np.ascontiguousarray(action, np.float32))
        info = {"reward_terms": dict(zip(self._terms, terms.tolist(), strict=True))}
        return observation, float(terms @ self._prices), terminated, truncated, info

    def state(self) -> dict[str, Any]:
        """The present state, for `reset(options={"state": ...})` here or in another engine with the same robot."""
        state: dict[str, Any] = json.loads(self._simulator.state())
        return state

    def close(self) -> None:
        """Ends the simulator. Does nothing when it has ended already."""
        self._opened = None


def _json(table: Mapping[str, Any]) -> str:
    """As JSON, with NumPy's arrays and numbers as lists and numbers."""
    return json.dumps(dict(table), default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{value!r} is {type(value).__name__}, expected what JSON can hold, or NumPy's arrays and numbers")


def make(
    config: Mapping[str, Any],
    task: Mapping[str, float] | None = None,
    max_episode_steps: int | None = 1000,
) -> gymnasium.Env[Array, Array]:
    """The simulator of a config as an environment, with a time limit in control steps (None: no limit).

    `config` is the `[simulator]` table of an elo config; `task` are parameters of the task, the others keep their
    defaults. Several at once: `gymnasium.vector.SyncVectorEnv([lambda: make(config)] * n)`; each of them goes on by itself after an
    end, in `task`, whatever `reset(options={"task": ...})` had set.

    Raises TypeError for what is no table, ValueError for a config with faults and RuntimeError for an engine that this build lacks.
    """
    environment: gymnasium.Env[Array, Array] = Environment(config, task)
    if max_episode_steps is not None:
        environment = gymnasium.wrappers.TimeLimit(environment, max_episode_steps)
    return environment


class OptionsWrapper(gymnasium.Wrapper[Array, Any, Array, Array]):
    """An environment in which an action is an option that runs to its end.

    Without `primitive` the action is the number of an option, `Discrete(K)`. With it the action is a Box of 1 + K + J
    numbers: the greatest of the first 1 + K chooses a primitive action (the first) or an option, and the last J, as far
    as the wrapped environment's bounds allow, are the primitive action.

    `discount` is γ per step, in (0, 1]. Raises ValueError where it is not, and where sizes, bounds or control step of the options
    are not the environment's.

    `draw()` is the infant agent's choice: `step(draw())` again and again is that agent. What it and the options draw comes from a
    generator of the wrapper's own, which `reset(seed=...)` seeds; the wrapped environment's is left to it.

    The reward of a decision that lasted n steps is the SMDP's, `r_1 + γ r_2 + … + γ^(n-1) r_n`, and so are
    `info["reward_terms"]` where the environment tells them. `info` also tells `steps` (n), `discount` (γ^n, by which a learner must
    discount what follows), `return` (the undiscounted sum) and `option` (its number, or -1).

    Learners for MDPs, Stable-Baselines3's among them, do not read `info["discount"]`: they discount each decision by one number. That
    is right where all decisions last n steps, with γ^n as that number. Where they do not (`primitive`, or options that end by
    chance) such a learner values what follows a long decision too much and what follows a short one too little.

    `step` raises IndexError for the number of no option, TypeError for what is no whole number, and, with `primitive`, ValueError for an
    array of another shape.
    """

    def __init__(
        self,
        env: gymnasium.Env[Array, Array],
        options: OptionSet,
        primitive: bool = False,
        discount: float = 0.99,
    ) -> None:
        super().__init__(env)
        if not 0.0 < discount <= 1.0:
            raise ValueError(f"`discount` is {discount}, expected a number above 0 and at most 1")
        if not isinstance(options, OptionSet):
            raise TypeError(f"`options` is {options!r}, expected an option set, such as `elo.load` gives")
        inner = _matching(env, options)
        self.options, self.discount, self._primitive = options, discount, primitive
        if primitive:
            choice = np.ones(1 + len(options), np.float32)
            low, high = np.concatenate([-choice, inner.low]), np.concatenate([choice, inner.high])
            self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        else:
            self.action_space = gymnasium.spaces.Discrete(len(options))
        self._observation: Array = np.zeros(options.observation_size, np.float32)
        self._generator = np.random.default_rng()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        if seed is not None:
            # Another stream than the wrapped environment makes of the same seed.
            self._generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
        self._observation, info = self.env.reset(seed=seed, options=options)
        return self._observation, info

    def step(self, action: Any) -> Step:
        option, torques = self._decide(action)
        reward, total, weight, steps = 0.0, 0.0, 1.0, 0
        terms: dict[str, float] = {}
        over = False
        while not over:
            taken = self._act(option, steps) if torques is None else torques
            self._observation, gained, terminated, truncated, info = self.env.step(taken)
            reward, total = reward + weight * float(gained), total + float(gained)
            told = info.get("reward_terms")
            for name, term in told.items() if isinstance(told, Mapping) else ():
                terms[name] = terms.get(name, 0.0) + weight * term
            weight, steps = weight * self.discount, steps + 1
            over = terminated or truncated or torques is not None or self._ends(option, steps)
        info = {**info, "option": option, "steps": steps, "discount": weight, "return": total}
        if terms:
            info["reward_terms"] = terms
        return self._observation, reward, terminated, truncated, info

    def draw(self) -> int:
        """The option that an infant agent begins now: by interest, π_I of Eq. 6.3; uniformly where options have none.

        With `primitive` the number is still that of an option, not an action of the wrapper.
        """
        return self.options.draw(self._observation, self._generator)

    def _decide(self, action: Any) -> tuple[int, Array | None]:
        """The option that an action means, or -1 and the primitive action."""
        count = len(self.options)
        if not self._primitive:
            option = operator.index(action)
            if not 0 <= option < count:
                raise IndexError(f"option {option} of a set of {count}")
            return option, None
        action = np.asarray(action, np.float32)
        if action.shape != self.action_space.shape:
            raise ValueError(f"expected an action of shape {self.action_space.shape}, got {action.shape}")
        option = int(np.argmax(action[: 1 + count])) - 1
        return option, action[1 + count :] if option < 0 else None

    def _act(self, option: int, elapsed: int) -> Array:
        return self.options.act(option, self._observation, elapsed, int(self._generator.integers(2**63)))

    def _ends(self, option: int, steps: int) -> bool:
        probability = self.options.termination(option, self._observation, steps)
        return probability >= 1.0 or (probability > 0.0 and bool(self._generator.random() < probability))


def _matching(env: gymnasium.Env[Array, Array], options: OptionSet) -> gymnasium.spaces.Box:
    """The environment's actions, if it is one that the options were made for."""
    shape, inner = env.observation_space.shape, env.action_space
    if not isinstance(inner, gymnasium.spaces.Box):
        raise ValueError(f"expected a Box of actions, got {inner}")
    if shape != (options.observation_size,) or inner.shape != options.action_low.shape:
        raise ValueError(
            f"the options are of a robot with {options.observation_size} observations and {options.action_low.size} "
            f"actions, the environment has {shape} and {inner.shape}"
        )
    if not (np.allclose(inner.low, options.action_low) and np.allclose(inner.high, options.action_high)):
        raise ValueError(
            f"the options' actions lie between {options.action_low} and {options.action_high}, the environment's between {inner.low} and "
            f"{inner.high}; wrap it by gymnasium.wrappers.RescaleAction"
        )
    control_step = getattr(env.unwrapped, "control_step", None)
    if isinstance(control_step, numbers.Real) and not np.isclose(float(control_step), options.control_step):
        raise ValueError(f"the options act every {options.control_step} s, the environment every {control_step} s")
    return inner
