"""The bare loop that the bridge is compared with: open-loop episodes in one environment of `roboschool_bullet.py`.

    python bridge.py ROBOT FILE STEPS EPISODES

FILE holds the actions of some motions of STEPS steps, as float32; each is played from the resets by the seeds 0 to
EPISODES - 1, until the fall. Prints `ready`, waits for a line, then prints the steps taken and the seconds that they took.
"""

import sys
import time

import numpy as np
from roboschool_bullet import RoboschoolBullet

robot, file, steps, episodes = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
environment = RoboschoolBullet(robot)
motions = np.fromfile(file, np.float32).reshape(-1, steps, *environment.action_space.shape)
environment.reset(seed=0)
print("ready", flush=True)
input()
begin, taken = time.perf_counter(), 0
for motion in motions:
    for episode in range(episodes):
        observation, _ = environment.reset(seed=episode)
        for action in motion:
            observation, reward, terminated, truncated, info = environment.step(action)
            taken += 1
            if terminated or truncated:
                break
print(taken, time.perf_counter() - begin)
