#!/usr/bin/env python3
"""Contact: lowers a hand onto a table and turns back when the run reports the contact.

PYTHONPATH=python .venv/bin/python examples/python/contact_events.py
"""

import multipanda as mp
import numpy as np


def main():
    with mp.run("one_arm") as run:
        arm, law = run.arms["arm"], run["cartesian"]
        above = mp.Pose(np.array([0.45, 0.2, 0.25]), arm.state.pose.quaternion_wxyz)  # the table's top is at 0.2 m
        law.goal("pose", above, duration_s=2).wait()

        events = run.events()  # from now on; none is missed
        law.goal("pose", above.moved(z=-0.12), duration_s=3)  # into the table: the spring presses
        for event in events:
            print(f"{event.t_s:.3f} s  {event.arm}  {event.kind}: {event.text}")
            if event.kind == "contact":
                state = arm.state
                print(f"at {1e3 * state.pose.position_m[2]:.0f} mm, force {state.wrench_n_nm[2]:.1f} N")
                law.goal("pose", above, duration_s=1)
            elif event.kind == "contact_ended":
                break
        law.goal("pose", above, duration_s=1).wait()
        print("held by the law:", arm.state.controllet)
    print(run.summary)


if __name__ == "__main__":
    main()
