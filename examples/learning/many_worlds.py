#!/usr/bin/env python3
"""Many worlds at once: the same policy on hidden plants, each with other masses, friction and delays.

PYTHONPATH=python .venv/bin/python examples/learning/many_worlds.py --worlds 16
"""

import argparse
import time

import gymnasium
import multipanda.gym  # noqa: F401 (registers the environments)
import numpy as np
from multipanda.tasks.scripted import press


def run(worlds, plants):
    envs = gymnasium.make_vec(
        "multipanda/PressCircle-v0",
        num_envs=worlds,
        vectorization_mode="vector_entry_point",
        action="wrench",
        plants=plants,
    )
    observation, _ = envs.reset(seed=1)
    errors, steps, begin = [], envs.unwrapped.limit, time.perf_counter()
    for _ in range(steps):
        observation, _, _, _, info = envs.step(press(observation))
        errors.append(info["force_error_n"])
    seconds = time.perf_counter() - begin
    envs.close()
    pressed = np.array(errors)[32:47]  # the force has settled, and the tool still presses
    return np.sqrt(np.mean(pressed**2, axis=0)), worlds * steps / seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=16)
    options = parser.parse_args()
    for plants in (False, True):
        error, rate = run(options.worlds, plants)
        name = "hidden plants" if plants else "the scene's plant"
        print(f"{name}: force error {np.median(error):.2f} N, worst {error.max():.2f} N; {rate:.0f} steps/s")


if __name__ == "__main__":
    main()
