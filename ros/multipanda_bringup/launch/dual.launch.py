"""Starts two arms side by side, both owned by the multimode controller. Accepts every argument of arms.launch.py."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

DEFAULTS = {"arm_names": "left right"}


def generate_launch_description():
    share = get_package_share_directory("multipanda_bringup")
    declared = [
        DeclareLaunchArgument(name, default_value=value.format(share=share)) for name, value in DEFAULTS.items()
    ]
    return LaunchDescription(
        [
            *declared,
            IncludeLaunchDescription(PythonLaunchDescriptionSource(os.path.join(share, "launch", "arms.launch.py"))),
        ]
    )
