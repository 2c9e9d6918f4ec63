#!/usr/bin/env python3
"""A gripper: grasps a box, declares its load, lifts it, puts it down. Each call returns when the fingers rest.

PYTHONPATH=python .venv/bin/python examples/python/gripper.py
"""

import multipanda as mp

BOX_WIDTH_M, BOX_MASS_KG = 0.04, 0.3


def main():
    with mp.run("grippers") as run:
        arm, law = run.arms["left"], run["left_pose"]
        arm.gripper.homing()  # finds the range of the fingers
        arm.gripper.move(0.07)
        try:
            arm.gripper.grasp(0.02, force_n=20)  # the box between the fingers is wider
        except mp.Refused as refused:
            print("refused:", refused.reason)
            arm.gripper.move(0.07)

        arm.gripper.grasp(BOX_WIDTH_M, force_n=30)
        print(f"grasped: {1e3 * arm.gripper.state.width_m:.0f} mm wide")
        arm.set_load(BOX_MASS_KG, [0, 0, 0.1])  # center of mass in the flange frame; the arm now compensates it

        start = arm.state.pose
        law.goal("pose", start.moved(z=0.08), duration_s=1.5).wait()
        risen = arm.state.pose.position_m[2] - start.position_m[2]
        print(f"lifted: {1e3 * risen:.0f} mm, still grasped: {arm.gripper.state.grasped}")
        law.goal("pose", start, duration_s=1.5).wait()
        arm.set_load(0, [0, 0, 0])
        arm.gripper.move(0.07)
        print(f"released: {1e3 * arm.gripper.state.width_m:.0f} mm wide")
    print(run.summary)


if __name__ == "__main__":
    main()
