"""Learning curves of Stable-Baselines3's PPO on this project's robots, as CSV with the columns of `learning-curves`.

    python examples/measurements/sb3_ppo.py mujoco ant 1000000 3 > curve.csv

Arguments: engine, robot, simulator steps, number of seeds or a range of them (`8..10`, both included). Needs `pip install ./python stable-baselines3 mujoco==3.17.0`.

What differs from SB3's defaults: observations and rewards are normalised (`VecNormalize`), γ is 0.98 and the step size falls
linearly to 0, as in this project's PPO. A figure is the mean return of 20 whole episodes: 1000 control steps, standard
reset, mean action.
"""

import sys

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import elo.gym

EPISODES, POINTS, GAMMA = 20, 10, 0.98


def environment(engine, robot):
    return DummyVecEnv([lambda: elo.gym.make({"kind": engine, "robot": robot})])


class Curve(BaseCallback):
    """Prints a line at equal distances, measured in an environment of its own."""

    def __init__(self, engine, robot, seed, every):
        super().__init__()
        self._name, self._every, self._next = f"{engine},{robot},{seed}", every, every
        self._world = elo.gym.make({"kind": engine, "robot": robot})

    def _on_step(self):
        return True

    def _on_rollout_start(self):
        # The policy has just been improved.
        if self.num_timesteps >= self._next:
            self._next += self._every
            self.measure()

    def measure(self):
        returns, lengths, falls = [], [], []
        for episode in range(EPISODES):
            observation, _ = self._world.reset(seed=episode)
            total, length, over = 0.0, 0, False
            while not over:
                seen = self.training_env.normalize_obs(observation)
                action, _ = self.model.predict(seen, deterministic=True)
                observation, reward, fallen, truncated, _ = self._world.step(action)
                total, length, over = total + reward, length + 1, fallen or truncated
            returns.append(total), lengths.append(length), falls.append(fallen)
        print(
            f"{self._name},{self.num_timesteps},{np.mean(returns):.1f},{np.std(returns, ddof=1):.1f},"
            f"{np.mean(lengths):.1f},{np.mean(falls):.2f}",
            flush=True,
        )


def main():
    engine, robot, steps = sys.argv[1], sys.argv[2], int(sys.argv[3])
    first, last = sys.argv[4].split("..") if ".." in sys.argv[4] else (1, sys.argv[4])
    torch.set_num_threads(1)
    print("engine,robot,seed,steps,mean_return,standard_deviation,mean_length,falls")
    for seed in range(int(first), int(last) + 1):
        world = VecNormalize(environment(engine, robot), gamma=GAMMA)
        model = PPO("MlpPolicy", world, gamma=GAMMA, learning_rate=lambda left: 3e-4 * left, seed=seed, device="cpu")
        curve = Curve(engine, robot, seed, steps // POINTS)
        model.learn(steps, callback=curve)
        curve.measure()


if __name__ == "__main__":
    main()
