#!/usr/bin/env python3
"""A task of your own: the hand is to go round a point without being told how. Any scene and any law will do.

PYTHONPATH=python .venv/bin/python examples/learning/own_task.py
"""

import gymnasium
import numpy as np
from multipanda.gym import TaskEnv, TaskVectorEnv
from multipanda.tasks import ActionMapping, Judgment, PosePart, Reach, Start


class Orbit(Reach):
    """The hand goes round a point at a distance of 5 cm, in the plane of the table.

    Reward: exp(-(error of the distance / 1 cm)^2). Success: within 1 cm of it.
    """

    name = "Orbit"
    actions = ("pose",)
    seconds = 3.0

    def _mapping(self, kind):
        part = PosePart("cartesian", "pose", ["arm"], self.arms[0].base, step_m=0.01, leash_m=0.05)
        return ActionMapping(["cartesian"], [part])

    def draw(self, random):
        start = super().draw(random)
        center = np.array([0.31, 0, 0.487]) + random.uniform(-0.02, 0.02, 3)
        return Start(q_rad=start.q_rad, numbers={"point_m": center})

    def judge(self, states, truth, numbers, t_s):
        away = (states["arm"].pose[:, :3] - numbers["point_m"])[:, :2]
        error = np.abs(np.linalg.norm(away, axis=1) - 0.05)
        none = np.zeros(len(error), dtype=bool)
        return Judgment(np.exp(-((error / 0.01) ** 2)), error < 0.01, none, {"error_m": error})


def policy(task, observation):
    names = task.observation_names
    hand = observation[:, [names.index(f"arm_{axis} [m]") for axis in "xyz"]]
    point = observation[:, [names.index(f"point_{axis} [m]") for axis in "xyz"]]
    away = hand - point
    angle = np.arctan2(away[:, 1], away[:, 0]) + 0.4  # a little ahead
    goal = point + 0.05 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    return np.clip(40 * (goal - hand), -1, 1)


def main():
    gymnasium.register(
        id="Orbit-v0",
        entry_point=lambda **options: TaskEnv(Orbit(), **options),
        vector_entry_point=lambda num_envs=1, **options: TaskVectorEnv(Orbit(), num_envs, **options),
    )
    envs = gymnasium.make_vec("Orbit-v0", num_envs=4, vectorization_mode="vector_entry_point")
    observation, _ = envs.reset(seed=1)
    rewards = []
    for _ in range(60):
        observation, reward, *_ = envs.step(policy(Orbit(), observation))
        rewards.append(reward)
    envs.close()
    print(f"mean reward of the last second: {np.mean(rewards[-20:]):.2f}")


if __name__ == "__main__":
    main()
