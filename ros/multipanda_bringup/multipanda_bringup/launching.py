"""Shared by launch files for a few arms: arms.launch.py with other defaults."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

SHARE = get_package_share_directory("multipanda_bringup")


def arms_with(**defaults):
    """A launch description that accepts every argument of arms.launch.py."""
    declared = [DeclareLaunchArgument(name, default_value=value) for name, value in defaults.items()]
    arms = PythonLaunchDescriptionSource(os.path.join(SHARE, "launch", "arms.launch.py"))
    return LaunchDescription([*declared, IncludeLaunchDescription(arms)])
