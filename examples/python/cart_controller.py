"""A teacher and a metric of one's own, as `taught_cart.toml` beside this file uses them."""

from __future__ import annotations

import numpy as np


def controller(task: dict[str, float], seed: int, stiffness: float = 2.0):
    """A policy that holds the gusty cart near 0 in a task: a spring, a damper, and a force against the task's wind."""

    def act(observation: np.ndarray, noise: np.random.Generator | None) -> np.ndarray:
        place, speed = observation
        force = -stiffness * (place + 0.5 * speed) - task.get("wind", 0.0) / 10.0
        if noise is not None:  # a sample; None asks for the mean action
            force += 0.1 * noise.standard_normal()
        return np.clip([force], -1.0, 1.0)

    return act


def cvar(returns: np.ndarray, mean: float, standard_deviation: float, share: float = 0.1) -> np.ndarray:
    """Conditional value at risk: the mean of the worst `share` of each row's returns (Rockafellar and Uryasev 2000)."""
    count = max(1, round(share * returns.shape[1]))
    return np.sort(returns, axis=1)[:, :count].mean(axis=1)
