"""Stable-Baselines3's PPO on an MJCF file of the half-cheetah.

Usage: sb3_ppo.py MJCF STEPS. Prints environment steps per second of processor time, updates included, on one thread.
Observation: positions but the first, and velocities (17 numbers); reward: forward speed minus a tenth of the squared
actions; episodes end after 1000 steps.
"""

import os
import sys
import time

os.environ["OMP_NUM_THREADS"] = "1"

import gymnasium
import mujoco
import numpy as np
import torch
from gymnasium.envs.mujoco import MujocoEnv
from stable_baselines3 import PPO

FRAME_SKIP = 4


class HalfCheetah(MujocoEnv):
    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}

    def __init__(self, path):
        model = mujoco.MjModel.from_xml_path(path)
        # Gymnasium insists on the frame rate that follows from the time step.
        self.metadata = {**self.metadata, "render_fps": int(np.round(1.0 / (model.opt.timestep * FRAME_SKIP)))}
        size = model.nq - 1 + model.nv
        space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
        super().__init__(path, FRAME_SKIP, observation_space=space)

    def step(self, action):
        before = self.data.qpos[0]
        self.do_simulation(action, self.frame_skip)
        speed = (self.data.qpos[0] - before) / self.dt
        return self.observe(), speed - 0.1 * float(np.square(action).sum()), False, False, {}

    def reset_model(self):
        noise = self.np_random.uniform(-0.1, 0.1, self.model.nq)
        self.set_state(self.init_qpos + noise, self.init_qvel)
        return self.observe()

    def observe(self):
        return np.concatenate([self.data.qpos[1:], self.data.qvel])


def main():
    path, steps = os.path.abspath(sys.argv[1]), int(sys.argv[2])
    torch.set_num_threads(1)
    environment = gymnasium.wrappers.TimeLimit(HalfCheetah(path), 1000)
    policy = {"net_arch": [64, 64]}
    learner = PPO(
        "MlpPolicy", environment, n_steps=2048, batch_size=64, n_epochs=10, policy_kwargs=policy, device="cpu", seed=1
    )
    learner.learn(2048)  # Warms up.
    begin = time.process_time()
    learner.learn(steps)
    print(steps / (time.process_time() - begin))


main()
