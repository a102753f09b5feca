"""This project's robots as Gymnasium environments, and environments whose actions are options."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from elo import _elo
from elo._options import OptionSet

Array = npt.NDArray[np.float32]
Step = tuple[Array, float, bool, bool, dict[str, Any]]


class Environment(gymnasium.Env[Array, Array]):
    """One of the simulators that configs name, e.g. `{"kind": "rapier", "robot": "ant"}`.

    `reset(options={"task": {...}})` sets the task's parameters, `reset(options={"state": ...})` begins in a state that
    `state()` gave. `info["reward_terms"]` holds the unpriced terms of the reward. There is no time limit.
    """

    def __init__(self, config: Mapping[str, Any], task: Mapping[str, float] | None = None) -> None:
        self._simulator = _elo.Simulator(json.dumps(dict(config)))
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

    def _set_task(self, task: Mapping[str, float]) -> None:
        text = json.dumps(dict(task))
        self._prices = np.asarray(self._simulator.prices(text))
        self._task = text

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        options = options or {}
        self._set_task(options.get("task", self._default_task))
        start = {"state": options["state"]} if "state" in options else {"seed": int(self.np_random.integers(2**63))}
        return self._simulator.reset(self._task, json.dumps(start)), {}

    def step(self, action: Array) -> Step:
        observation, terms, terminated, truncated = self._simulator.step(np.asarray(action, np.float32))
        info = {"reward_terms": dict(zip(self._terms, terms.tolist(), strict=True))}
        return observation, float(terms @ self._prices), terminated, truncated, info

    def state(self) -> dict[str, Any]:
        """The present state, for `reset(options={"state": ...})` here or in another engine with the same robot."""
        state: dict[str, Any] = json.loads(self._simulator.state())
        return state


def make(
    config: Mapping[str, Any],
    task: Mapping[str, float] | None = None,
    max_episode_steps: int | None = 1000,
) -> gymnasium.Env[Array, Array]:
    """The simulator of a config as an environment, with a time limit in control steps (None: no limit).

    `config` is the `[simulator]` table of an elo config; `task` are parameters of the task, the others keep their
    defaults. Several at once: `gymnasium.vector.SyncVectorEnv([lambda: make(config)] * n)`.

    Raises ValueError for a config with faults and RuntimeError for an engine that this build lacks.
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

    `draw()` is the infant agent's choice: `step(draw())` again and again is that agent.

    The reward of a decision that lasted n steps is the SMDP's, `r_1 + γ r_2 + … + γ^(n-1) r_n`. `info` tells `steps` (n),
    `discount` (γ^n, by which a learner must discount what follows), `return` (the undiscounted sum) and `option` (its number,
    or -1).
    """

    def __init__(
        self,
        env: gymnasium.Env[Array, Array],
        options: OptionSet,
        primitive: bool = False,
        discount: float = 0.99,
    ) -> None:
        super().__init__(env)
        shape, inner = env.observation_space.shape, env.action_space
        if shape != (options.observation_size,) or inner.shape != options.action_low.shape:
            raise ValueError(
                f"the options are of a robot with {options.observation_size} observations and {options.action_low.size} "
                f"actions, the environment has {shape} and {inner.shape}"
            )
        if not isinstance(inner, gymnasium.spaces.Box):
            raise ValueError(f"expected a Box of actions, got {inner}")
        self.options, self.discount, self._primitive = options, discount, primitive
        if primitive:
            choice = np.ones(1 + len(options), np.float32)
            low, high = np.concatenate([-choice, inner.low]), np.concatenate([choice, inner.high])
            self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        else:
            self.action_space = gymnasium.spaces.Discrete(len(options))
        self._observation: Array = np.zeros(options.observation_size, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        self._observation, info = self.env.reset(seed=seed, options=options)
        return self._observation, info

    def step(self, action: Any) -> Step:
        option = int(np.argmax(action[: 1 + len(self.options)])) - 1 if self._primitive else int(action)
        reward, total, weight, steps = 0.0, 0.0, 1.0, 0
        terminated = truncated = False
        info: dict[str, Any] = {}
        while not (terminated or truncated):
            if option < 0:
                torques = np.asarray(action[1 + len(self.options) :], np.float32)
            else:
                torques = self.options.act(option, self._observation, steps, int(self.np_random.integers(2**63)))
            self._observation, gained, terminated, truncated, info = self.env.step(torques)
            reward, total, weight, steps = reward + weight * float(gained), total + float(gained), weight * self.discount, steps + 1
            if option < 0 or self._ends(option, steps):
                break
        info = {**info, "option": option, "steps": steps, "discount": weight, "return": total}
        return self._observation, reward, terminated, truncated, info

    def draw(self) -> int:
        """The option that an infant agent begins now: by interest, π_I of Eq. 6.3; uniformly where options have none.

        With `primitive` the number is still that of an option, not an action of the wrapper.
        """
        return self.options.draw(self._observation, self.np_random)

    def _ends(self, option: int, steps: int) -> bool:
        probability = self.options.termination(option, self._observation, steps)
        return probability >= 1.0 or (probability > 0.0 and bool(self.np_random.random() < probability))
