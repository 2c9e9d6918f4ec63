#!/usr/bin/env python3
"""Steps per second of the vector environments and of their worlds alone, in the same run: the cost of Python.

PYTHONPATH=python .venv/bin/python benchmarks/gym_throughput.py
PYTHONPATH=python .venv/bin/python benchmarks/gym_throughput.py --require 0.9

Both are measured in turns, a second each; the figure is the median of the turns. With --require it fails below that
ratio. docs/results/benchmarks.md has the figures, and those of other environments.
"""

import argparse
import sys
import time

import gymnasium
import multipanda.gym  # noqa: F401 (registers the environments)
import numpy as np
from multipanda.tasks import TASKS
from multipanda.tasks.scripted import SCRIPTED


def turn(step, seconds):
    """Calls per second."""
    begin, count = time.perf_counter(), 0
    while (now := time.perf_counter()) < begin + seconds:
        step()
        count += 1
    return count / (now - begin)


def measured(name, worlds, seconds, turns):
    action, policy = SCRIPTED[name]
    envs = gymnasium.make_vec(
        f"multipanda/{name}-v0",
        num_envs=worlds,
        vectorization_mode="vector_entry_point",
        action=action,
        max_episode_steps=10**9,
    )
    observation, _ = envs.reset(seed=1)
    bare, task = envs.unwrapped, TASKS[name]
    chosen = policy(observation.astype(np.float64))
    everybody = np.ones(worlds, dtype=np.bool_)
    mapping = bare.mapping
    start = mapping.command(np.zeros_like(chosen), bare.worlds.states(), bare.task.around(bare._numbers, bare._time()))

    def alone():
        bare.worlds.send(start, everybody)
        bare.worlds.step(mapping.cycles, everybody)

    def whole():
        envs.step(np.zeros_like(chosen))

    rates = {"alone": [], "whole": []}
    for _ in range(turns):
        rates["alone"].append(worlds * turn(alone, seconds))
        rates["whole"].append(worlds * turn(whole, seconds))
    begin = time.perf_counter()
    envs.reset(seed=2)
    reset_s = (time.perf_counter() - begin) / worlds
    envs.close()
    alone_rate, whole_rate = (float(np.median(rates[kind])) for kind in ("alone", "whole"))
    ratio = float(np.median(np.array(rates["whole"]) / np.array(rates["alone"])))
    share = reset_s * whole_rate / (task.seconds * 20)  # of the time, if episodes run to completion
    print(
        f"| {name} | {worlds} | {alone_rate:.0f} | {whole_rate:.0f} | {ratio:.3f} | {whole_rate / 20:.0f} | "
        f"{1e3 * reset_s:.1f} ms | {whole_rate / (1 + share):.0f} |",
        flush=True,
    )
    return ratio


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=1.0, help="of a turn")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--require", type=float, help="smallest ratio")
    options = parser.parse_args()
    print("| task | worlds | worlds alone | environment | ratio | × real time | reset of a world | with resets |")
    print("|---|---|---|---|---|---|---|---|")
    ratios = [measured(name, options.worlds, options.seconds, options.turns) for name in TASKS]
    if options.require is not None and min(ratios) < options.require:
        sys.exit(f"the smallest ratio is {min(ratios):.3f}, below {options.require}")


if __name__ == "__main__":
    main()
