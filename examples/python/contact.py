#!/usr/bin/env python3
"""Contact: lowers a hand onto a table and turns back when the estimated force says that it touches.

PYTHONPATH=python .venv/bin/python examples/python/contact.py
"""

import argparse

import multipanda as mp
import numpy as np

CONTACT_N, GONE_N = 15, 5


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", default="runs", help="folder for the log")
    options = parser.parse_args()
    with mp.run("one_arm", record=options.record) as run:
        arm, law = run.arms["arm"], run["cartesian"]
        above = mp.Pose(np.array([0.45, 0.2, 0.25]), arm.state.pose.quaternion_wxyz)  # the table's top is at 0.2 m
        law.goal("pose", above, duration_s=2).wait()

        touching = False
        law.goal("pose", above.moved(z=-0.12), duration_s=3)  # into the table: the spring presses
        for state in run.states(100):  # [Hz]
            arm_state = state.arms["arm"]
            force = arm_state.wrench_n_nm[2]  # that the arm exerts, in world axes: pressing down is negative
            if not touching and force < -CONTACT_N:
                touching = True
                print(f"contact at {1e3 * arm_state.pose.position_m[2]:.0f} mm, force {force:.1f} N")
                law.goal("pose", above, duration_s=1)
            elif touching and force > -GONE_N:
                print(f"contact ended after {state.t_s:.2f} s of the run")
                break
        state = law.goal("pose", above, duration_s=1).wait()
        print("owner:", state.controllet)
    # What happened between two looks is in the log, with its exact cycle.
    force = mp.read_log(run.log)["arm/wrench/estimated_force"][:, 2]
    print(f"largest force in the log: {force.min():.1f} N in {len(force)} cycles")


if __name__ == "__main__":
    main()
