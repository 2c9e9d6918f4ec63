"""Starts two pairs of arms that face each other. Accepts every argument of arms.launch.py."""

from multipanda_bringup.launching import arms_with


def generate_launch_description():
    return arms_with(arm_names="near_left near_right far_left far_right")
