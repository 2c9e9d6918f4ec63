"""Shared by launch files: their arguments, rviz, and arms.launch.py with other defaults."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = get_package_share_directory("multipanda_bringup")


def launched(arguments, set_up):
    """A launch description: `arguments` are (default, text) by name, set_up(values by name) returns what is started."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in arguments.items()
    ]
    values = {name: LaunchConfiguration(name) for name in arguments}

    def start(context):
        return set_up({name: value.perform(context) for name, value in values.items()})

    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def rviz(given, config, **options):
    """Rviz in a list, if it is asked for."""
    if given["rviz"].lower() not in ("true", "1"):
        return []
    return [Node(package="rviz2", executable="rviz2", output="log", arguments=["-d", config], **options)]


def arms_with(**defaults):
    """A launch description that accepts every argument of arms.launch.py."""
    declared = [DeclareLaunchArgument(name, default_value=value) for name, value in defaults.items()]
    arms = PythonLaunchDescriptionSource(os.path.join(SHARE, "launch", "arms.launch.py"))
    return LaunchDescription([*declared, IncludeLaunchDescription(arms)])
