"""Between a callable that gives policies and `backends/src/python/teacher.rs`."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from elo._bridge import BadTarget, find, hashes, origins, versions

Array = npt.NDArray[np.float32]


class Bridge:
    """What makes the policies of a run."""

    def __init__(self, config: str) -> None:
        self._config: dict[str, Any] = json.loads(config)
        self._target = find(self._config["target"])

    def describe(self) -> str:
        """What there is to know before a run: the versions."""
        return self.versions()

    def versions(self) -> str:
        """What the policies depend on."""
        return ", ".join([versions(origins(self._config["target"], self._target)), *hashes(self._config["files"])])

    def policy(self, call: str, observation_size: int, action_size: int) -> Callable[[Array, int | None], Array]:
        """The policy for a task, tried once on an observation of zeros."""
        arguments = {**json.loads(call), **self._config["files"], **self._config["kwargs"]}
        policy = self._target(**arguments)
        if not callable(policy):
            raise BadTarget(f"`{self._config['target']}` gave {type(policy).__name__}, expected a policy to call")

        def act(observation: Array, seed: int | None) -> Array:
            action = np.asarray(policy(observation, None if seed is None else np.random.default_rng(seed)))
            if action.size != action_size or action.dtype.kind not in "fiu":
                raise BadTarget(
                    f"the policy of `{self._config['target']}` gave {action.dtype} of shape {action.shape}, expected "
                    f"{action_size} numbers"
                )
            if not np.isfinite(action).all():
                raise BadTarget(f"the policy of `{self._config['target']}` gave an action that is not finite")
            return action.astype(np.float32).reshape(-1)

        act(np.zeros(observation_size, np.float32), None)
        return act
