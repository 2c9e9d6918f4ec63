#!/usr/bin/env python3
"""The first arm: starts a simulation, lifts the hand by 5 cm and back, prints what was recorded.

PYTHONPATH=python .venv/bin/python examples/python/first_arm.py
PYTHONPATH=python .venv/bin/python examples/python/first_arm.py --address 172.16.0.2    a real arm
"""

import argparse

import multipanda as mp


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--address", help="address of a real arm (default: a simulated one)")
    parser.add_argument("--record", default="runs", help="folder for the log")
    options = parser.parse_args()
    address = {"arm": options.address} if options.address else None

    with mp.run("one_arm", address=address, record=options.record) as run:
        arm, law = run.arms["arm"], run["cartesian"]
        law.translational_stiffness_n_per_m = 400  # bounds and units: help(law)
        start = arm.state.pose
        for pose in (start.moved(z=0.05), start):
            state = law.goal("pose", pose, duration_s=1).wait()
            print("at", state.pose.position_m.round(4))
    # Here the arm is held, its motion is finished, the program has ended, and the log is complete.
    print(run.summary)
    log = mp.read_log(run.log)
    print("torques:", log["arm/tau_J"].shape, "largest:", round(float(abs(log["arm/tau_J"]).max()), 1), "N m")


if __name__ == "__main__":
    main()
