"""A Stable-Baselines3 model as a teacher of `elo`, and the training that makes one.

    python teacher.py half-cheetah 200000

trains PPO on a robot of this project in MuJoCo and writes `model.zip` and `normalizer.pkl` here, which `teacher.toml` uses.
Needs `pip install ./python stable-baselines3 mujoco==3.17.0`.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import elo.gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize


def load(task: dict[str, float], seed: int, model: str, normalizer: str):
    """The policy of a model and the normaliser that its observations went through. One model serves every task."""
    torch.set_num_threads(1)
    policy = PPO.load(model, device="cpu")
    with open(normalizer, "rb") as file:
        normalize: VecNormalize = pickle.load(file)  # executes what the file says: load only what you wrote

    def act(observation: np.ndarray, noise: np.random.Generator | None) -> np.ndarray:
        if noise is not None:
            torch.manual_seed(int(noise.integers(2**63)))
        return policy.predict(normalize.normalize_obs(observation), deterministic=noise is None)[0]

    return act


def main() -> None:
    robot, steps, here = sys.argv[1], int(sys.argv[2]), Path(__file__).parent
    torch.set_num_threads(1)
    world = VecNormalize(DummyVecEnv([lambda: elo.gym.make({"kind": "mujoco", "robot": robot})]), gamma=0.98)
    model = PPO("MlpPolicy", world, gamma=0.98, seed=1, device="cpu").learn(steps)
    model.save(here / "model.zip")
    world.save(here / "normalizer.pkl")


if __name__ == "__main__":
    main()
