"""Starts one arm. Accepts every argument of arms.launch.py."""

from multipanda_bringup.launching import arms_with


def generate_launch_description():
    return arms_with(arm_names="arm")
