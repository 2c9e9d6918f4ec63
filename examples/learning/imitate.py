#!/usr/bin/env python3
"""Imitation: a linear policy learns from a teacher's actions, by least squares, and is then tried on its own.

PYTHONPATH=python .venv/bin/python examples/learning/imitate.py
"""

import argparse

import gymnasium
import multipanda.gym  # noqa: F401 (registers the environments)
import numpy as np
from multipanda.tasks.scripted import reach


def rollout(policy, worlds, seed):
    """Observations, actions and final distances of one episode in each world."""
    envs = gymnasium.make_vec("multipanda/Reach-v0", num_envs=worlds, vectorization_mode="vector_entry_point")
    observation, _ = envs.reset(seed=seed)
    observations, actions = [], []
    for _ in range(envs.unwrapped.limit):
        action = policy(observation)
        observations.append(observation)
        actions.append(action)
        observation, _, _, _, info = envs.step(action)
    envs.close()
    return np.concatenate(observations), np.concatenate(actions), info["distance_m"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=16)
    options = parser.parse_args()
    seen, taught, _ = rollout(reach, options.worlds, seed=1)
    mean, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-6
    features = np.column_stack([(seen - mean) / scale, np.ones(len(seen))])
    weights = np.linalg.solve(features.T @ features + 1e-3 * np.eye(features.shape[1]), features.T @ taught)

    def learned(observation):
        return np.clip(np.column_stack([(observation - mean) / scale, np.ones(len(observation))]) @ weights, -1, 1)

    for name, policy in (("teacher", reach), ("pupil", learned)):
        _, _, distance = rollout(policy, options.worlds, seed=1000)
        print(f"{name}: {1e3 * np.median(distance):.1f} mm away at the end (median)")


if __name__ == "__main__":
    main()
