"""Starts the stand-alone program with ROS interfaces in place of a controller manager.

It publishes description, joint states and tf itself.

    ros2 launch multipanda_bringup standalone.launch.py program:=/path/to/multipanda scene:=two_arms
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import ExecuteProcess
from multipanda_bringup.launching import launched, rviz

ARGUMENTS = {
    "program": ("multipanda", "Path of the program (default: multipanda on PATH)"),
    "scene": ("two_arms", "Scene name or file"),
    "rviz": ("false", "Show the arms in rviz"),
}


def set_up(given):
    config = os.path.join(get_package_share_directory("multipanda_description"), "rviz", "arms.rviz")
    run = ExecuteProcess(cmd=[given["program"], "run", given["scene"], "--ros"], output="both")
    return [run, *rviz(given, config)]


def generate_launch_description():
    return launched(ARGUMENTS, set_up)
