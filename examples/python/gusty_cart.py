"""An environment of one's own: a cart that is pushed to a place against a wind, with tasks and reward terms.

`gusty_cart.toml` beside this file says how `elo` uses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np


class GustyCart(gymnasium.Env):
    """Observation: place (m) and speed (m/s). Action: force (10 N) from -1 to 1. The cart falls off the track at 2 m."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    control_step = 0.02
    mass = 1.0

    def __init__(self) -> None:
        self.wind = 0.0  # m/s², a task parameter: elo sets the attribute before each reset
        self.place = self.speed = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.place, self.speed = self.np_random.uniform(-0.5, 0.5), 0.0
        return self._observation(), {}

    def step(self, action: np.ndarray):
        force = float(action[0])
        self.speed += self.control_step * (10.0 * force / self.mass + self.wind)
        self.place += self.control_step * self.speed
        # Unpriced terms; the config says what a task pays for each.
        terms = {"closeness": float(np.exp(-(self.place**2))), "effort": force**2}
        return self._observation(), terms["closeness"], abs(self.place) > 2.0, False, {"reward_terms": terms}

    def get_state(self) -> dict[str, list[float]]:
        return {"positions": [self.place], "velocities": [self.speed], "memory": []}

    def set_state(self, state: Mapping[str, Any]) -> np.ndarray:
        self.place, self.speed = float(state["positions"][0]), float(state["velocities"][0])
        return self._observation()

    def _observation(self) -> np.ndarray:
        return np.array([self.place, self.speed], np.float32)
