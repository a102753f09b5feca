"""PPO whose actions are options beside PPO whose actions are torques, on the same robot and as many control steps.

    python over_options.py OPTION_SET STEPS plot.png

OPTION_SET is a folder that `elo discover` wrote for the half-cheetah. Needs `pip install ./python stable-baselines3 matplotlib`.

Rewards are the SMDP's: an option that runs n steps pays r_1 + γ r_2 + …, and what follows is worth γ^n as much. Stable-Baselines3
does not read `info["discount"]`, which tells γ^n, but discounts all decisions by one number. So the options must all last as
long as the set says (those of `kind = "interest"` do not, and are refused), and PPO over options gets that γ^n.
"""

from __future__ import annotations

import sys

import elo
import elo.gym
import matplotlib
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROBOT = {"kind": "rapier", "robot": "half-cheetah"}
DISCOUNT = 0.98


class Episodes(BaseCallback):
    """Notes the undiscounted return of each episode, and the control steps taken until its end."""

    def __init__(self, limit: int) -> None:
        super().__init__()
        self.limit, self.taken, self.total = limit, 0, 0.0
        self.steps: list[int] = []
        self.returns: list[float] = []

    def _on_step(self) -> bool:
        info = self.locals["infos"][0]
        self.taken += info.get("steps", 1)
        self.total += info.get("return", float(self.locals["rewards"][0]))
        if self.locals["dones"][0]:
            self.steps.append(self.taken)
            self.returns.append(self.total)
            self.total = 0.0
        return self.taken < self.limit


def train(environment, limit: int, **arguments) -> Episodes:
    episodes = Episodes(limit)
    PPO("MlpPolicy", environment, seed=1, device="cpu", **arguments).learn(limit, callback=episodes)
    return episodes


def smooth(episodes: Episodes, points: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Mean return of the episodes that ended in each of equally long stretches."""
    edges = np.linspace(0, episodes.limit, points + 1)
    places = np.digitize(episodes.steps, edges) - 1
    means = [np.mean(np.array(episodes.returns)[places == i]) if (places == i).any() else np.nan for i in range(points)]
    return edges[1:], np.array(means)


def check_lengths(options: elo.OptionSet) -> None:
    """Ends the program unless every option runs its `steps`, and no more."""
    observation = np.zeros(options.observation_size)
    for option in range(len(options)):
        for elapsed in range(1, options.steps + 1):
            if options.termination(option, observation, elapsed) != float(elapsed == options.steps):
                sys.exit(f"option {option} ends by chance; expected options of one fixed length, such as those of kind open_loop")


def main() -> None:
    options, limit, path = elo.load(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    check_lengths(options)
    torch.set_num_threads(1)
    over_options = elo.gym.OptionsWrapper(elo.gym.make(ROBOT), options, discount=DISCOUNT)
    curves = {
        "torques": train(elo.gym.make(ROBOT), limit, gamma=DISCOUNT),
        "options": train(over_options, limit, gamma=DISCOUNT**options.steps, n_steps=128, batch_size=64),
    }
    for name, episodes in curves.items():
        first = np.mean(episodes.returns[:50])
        print(f"{name}: {len(episodes.returns)} episodes, mean return of the first 50 {first:.1f}, of the last 50 "
              f"{np.mean(episodes.returns[-50:]):.1f}")
        plt.plot(*smooth(episodes), label=f"PPO over {name}")
    plt.xlabel("control steps")
    plt.ylabel("return of an episode")
    plt.legend()
    plt.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
