#!/usr/bin/env python3
"""The first environment: a scripted policy reaches for points, in one world.

PYTHONPATH=python .venv/bin/python examples/learning/first_environment.py
"""

import gymnasium
import multipanda.gym  # noqa: F401 (registers the environments)
from multipanda.tasks.scripted import reach


def main():
    env = gymnasium.make("multipanda/Reach-v0")
    observation, _ = env.reset(seed=1)
    for episode in range(3):
        total, over = 0.0, False
        while not over:
            action = reach(observation[None])[0]
            observation, reward, terminated, truncated, info = env.step(action)
            total += reward
            over = terminated or truncated
        print(f"episode {episode}: {1e3 * info['distance_m']:.1f} mm away, success: {info['is_success']}, {total:.1f}")
        observation, _ = env.reset()
    env.close()


if __name__ == "__main__":
    main()
