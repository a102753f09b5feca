"""Between a function that scores returns and `backends/src/python/scores.rs`."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from elo._bridge import BadTarget, find, origins, versions

Array = npt.NDArray[np.float64]


class Bridge:
    """One metric."""

    def __init__(self, config: str) -> None:
        self._config: dict[str, Any] = json.loads(config)
        self._target = find(self._config["target"])

    def describe(self) -> str:
        """The versions. Tries the function on returns of three options in twenty contexts first, so that one that cannot be called
        stops nothing later."""
        self.scores(np.random.default_rng(0).random((3, 20)), 0.5, 0.3)
        return self.versions()

    def versions(self) -> str:
        """What the scores depend on."""
        return versions(origins(self._config["target"], self._target))

    def scores(self, returns: Array, mean: float, standard_deviation: float) -> Array:
        """One score a row of `returns`."""
        given = self._target(returns, mean=mean, standard_deviation=standard_deviation, **self._config["kwargs"])
        scores = np.asarray(given)
        if scores.shape != (len(returns),) or scores.dtype.kind not in "fiu":
            raise BadTarget(
                f"`{self._config['target']}` gave {scores.dtype} of shape {scores.shape} for returns of shape "
                f"{returns.shape}, expected one number a row"
            )
        return np.ascontiguousarray(scores, np.float64)
