#!/usr/bin/env python3
"""From the environment to arms: a policy presses through the Python client on a strict virtual arm at 20 Hz.

A virtual arm is a process of its own that speaks the arm's network protocol and refuses what a real arm refuses. For a
real arm read docs/learning.md first, then give its address: --address 172.16.0.2

PYTHONPATH=python .venv/bin/python examples/learning/policy_on_arms.py
PYTHONPATH=python .venv/bin/python examples/learning/policy_on_arms.py --policy learn_press/results.json
"""

import argparse
import contextlib
import json
import pathlib

import multipanda as mp
import numpy as np
from multipanda.tasks import PressCircle, Start
from multipanda.tasks.drive import drive
from multipanda.tasks.press_circle import SURFACE_M
from multipanda.tasks.scripted import Observed, press


def learned(file):
    """The best learned policy of a file of learn_press.py."""
    from learn_press import action_of

    runs = json.loads(file.read_text())["variable"]
    best = np.array([max(runs, key=lambda one: one["reward"])["policy"]])
    return lambda observation: action_of(best, observation[None], variable=True)[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--policy", type=pathlib.Path, help="results of learn_press.py; default: a scripted policy")
    parser.add_argument("--address", help="a real arm's address; default: a virtual arm is started")
    parser.add_argument("--seconds", type=float, default=PressCircle.seconds)
    options = parser.parse_args()
    task, scene = PressCircle(), PressCircle.scene
    policy = learned(options.policy) if options.policy else (lambda observation: press(observation[None])[0])
    action = "impedance" if options.policy else "wrench"
    numbers = {"force_n": np.array([10.0]), "surface_error_m": np.array([0.001]), "turn": np.array([1.0])}
    with contextlib.ExitStack() as opened:
        address = options.address
        if address is None:
            arms = opened.enter_context(mp.virtual_arms(scene, lockstep=False, strict=True, arm_names=("arm",)))
            address = arms.addresses["arm"]
        # The first run of a scene on a physical arm is reduced; a virtual one may have the speeds of the training.
        speed = [] if options.address else ["--full-speed"]
        run = opened.enter_context(mp.run(scene, backend="fci", address={"arm": address}, arguments=speed))
        done = drive(run, task, policy, Start(numbers=numbers), action=action, seconds=options.seconds)
        seen = Observed(task, done.observations)
        pressing = seen["desired force [10 N], 0 for hovering"] > 0
        settled = pressing & (done.t_s > 1.3)
        force = -10 * seen["arm_fz [10 N]"]
        print(f"actions: {len(done.t_s)}, the latest {1e3 * done.latest_s:.1f} ms late")
        print(f"estimated force: {force[settled].mean():.1f} N of 10 N, the surface at {SURFACE_M} m")
        hovering = ~pressing & (done.t_s > 3.2)
        if hovering.any():
            error = (seen["arm_z [m]"] - seen["path_z [m]"])[hovering]
            print(f"height error while hovering: {1e3 * np.sqrt(np.mean(error**2)):.1f} mm")
        print(f"stopped: {run.state().arms['arm'].stopped}")


if __name__ == "__main__":
    main()
