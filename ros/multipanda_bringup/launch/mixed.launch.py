"""Starts a real arm and a simulated one.

The multimode controller owns the first, a trajectory controller the second. Accepts every argument of arms.launch.py.
"""

from multipanda_bringup.launching import SHARE, arms_with


def generate_launch_description():
    return arms_with(
        arm_names="left right",
        hardware="fci mujoco",
        addresses="172.16.0.2 none",
        controllers_file=f"{SHARE}/config/mixed.yaml",
    )
