#!/usr/bin/env python3
"""Learns to press along one half of a circle and to hover along the other, with variable and with fixed stiffness.

The policy has six numbers. Fixed: the hand's stiffness along the surface's normal is one learned number for the whole
episode (five numbers). The learner is the cross-entropy method: draw policies from a normal distribution, keep the best
quarter, fit the distribution to them. Everything is seeded.

PYTHONPATH=python .venv/bin/python examples/learning/learn_press.py --out runs/learn_press
"""

import argparse
import json
import pathlib
import time

import gymnasium
import multipanda.gym  # noqa: F401 (registers the environments)
import numpy as np
from multipanda.tasks import PressCircle

NAMES = PressCircle().observation_names
FORCE, DESIRED = NAMES.index("arm_fz [10 N]"), NAMES.index("desired force [10 N], 0 for hovering")
STEP_M = 0.1  # what an action of 1 moves
SOFT, STIFF = 100, 3000  # N/m, actions of -1 and 1


def action_of(policy, observation, variable):
    """The actions of policies, N x 6, for observations, N x n."""
    stiff, along, depth, feedback, height, stiff_hovering = np.asarray(policy, dtype=np.float64).T
    pressing = observation[:, DESIRED] > 0
    normal = np.clip(np.where(pressing, stiff, stiff_hovering) if variable else stiff, -1, 1)
    stiffness = SOFT * (STIFF / SOFT) ** (0.5 * (normal + 1))
    # A spring presses with the desired force if the set-point is that force over the stiffness below the surface.
    error = observation[:, DESIRED] + observation[:, FORCE]  # the arm's force on the surface is negative along z
    pressed = -10 * (np.exp(depth) * observation[:, DESIRED] + 0.1 * feedback * error) / stiffness
    action = np.zeros((len(observation), 6))
    action[:, 2] = np.where(pressing, pressed, 0.01 * height) / STEP_M
    action[:, 3:5] = along[:, None]
    action[:, 5] = normal
    return np.clip(action, -1, 1)


def episodes(envs, policies, variable, seeds):
    """The mean reward of a step, for each policy in a world of its own."""
    observation, _ = envs.reset(seed=seeds)
    total, running = np.zeros(envs.num_envs), np.ones(envs.num_envs, dtype=bool)
    limit = envs.unwrapped.limit
    for _ in range(limit):
        observation, reward, terminated, _, _ = envs.step(action_of(policies, observation, variable))
        total += reward * running
        running &= ~terminated
    return total / limit


def learn(variable, seed, generations, population, tries):
    """One learning run: the best mean of each generation, the policy, and its reward in 64 episodes never seen."""
    envs = gymnasium.make_vec(
        "multipanda/PressCircle-v0",
        num_envs=population * tries,
        vectorization_mode="vector_entry_point",
        action="impedance",
    )
    random = np.random.default_rng(seed)
    mean, deviation, curve = np.zeros(6), np.full(6, 0.6), []
    for generation in range(generations):
        policies = mean + deviation * random.normal(size=(population, 6))
        # All policies of a generation are tried in the same episodes.
        seeds = [1000 * (100 * seed + generation) + k for k in range(tries)] * population
        scores = episodes(envs, np.repeat(policies, tries, axis=0), variable, seeds)
        scores = scores.reshape(population, tries).mean(axis=1)
        best = policies[np.argsort(-scores)[: population // 4]]
        mean, deviation = best.mean(axis=0), best.std(axis=0) + 0.02
        curve.append(float(np.mean(scores)))
    envs.close()
    return mean, curve


def evaluate(policy, variable, count, seed=900_000):
    """The mean reward of a policy in episodes that no learning run has seen."""
    envs = gymnasium.make_vec(
        "multipanda/PressCircle-v0", num_envs=count, vectorization_mode="vector_entry_point", action="impedance"
    )
    seeds = [seed + k for k in range(count)]
    reward = float(np.mean(episodes(envs, np.repeat(policy[None], count, axis=0), variable, seeds)))
    envs.close()
    return reward


def draw(results, file):
    """The curves of all seeds and their means."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    for kind, color in (("variable", "tab:blue"), ("fixed", "tab:orange")):
        curves = np.array([one["curve"] for one in results[kind]])
        generations = np.arange(1, curves.shape[1] + 1)
        for curve in curves:
            axis.plot(generations, curve, color=color, alpha=0.3, linewidth=1)
        axis.plot(generations, curves.mean(axis=0), color=color, linewidth=2, label=f"{kind} stiffness")
    axis.set_xlabel("generation")
    axis.set_ylabel("mean reward of a step")
    axis.set_ylim(0, 1)
    axis.grid(alpha=0.3)
    axis.legend()
    figure.savefig(file, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="learning runs of each kind")
    parser.add_argument("--generations", type=int, default=15)
    parser.add_argument("--population", type=int, default=20)
    parser.add_argument("--tries", type=int, default=2, help="episodes of each policy in a generation")
    parser.add_argument("--evaluations", type=int, default=64, help="episodes of each learned policy afterwards")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("learn_press"), help="folder of the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results = {"variable": [], "fixed": []}
    for seed in range(1, options.seeds + 1):
        for kind in results:
            begin = time.monotonic()
            policy, curve = learn(kind == "variable", seed, options.generations, options.population, options.tries)
            reward = evaluate(policy, kind == "variable", options.evaluations)
            results[kind].append({"seed": seed, "policy": policy.tolist(), "curve": curve, "reward": reward})
            print(f"{kind} {seed}: reward {reward:.3f} after {time.monotonic() - begin:.1f} s", flush=True)
    (options.out / "results.json").write_text(json.dumps(results, indent=1))
    for kind, runs in results.items():
        rewards = [run["reward"] for run in runs]
        print(f"{kind} stiffness: reward {min(rewards):.3f} to {max(rewards):.3f} over {len(rewards)} seeds")
    draw(results, options.out / "curve.png")


if __name__ == "__main__":
    main()
