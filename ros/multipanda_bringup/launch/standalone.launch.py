"""Starts the stand-alone program with ROS interfaces in place of a controller manager.

It publishes description, joint states and tf itself.

    ros2 launch multipanda_bringup standalone.launch.py program:=/path/to/multipanda scene:=two_arms
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    rviz = os.path.join(get_package_share_directory("multipanda_description"), "rviz", "arms.rviz")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "program", default_value="multipanda", description="Path of the program (default: multipanda on PATH)"
            ),
            DeclareLaunchArgument("scene", default_value="two_arms", description="Scene name or file"),
            DeclareLaunchArgument("rviz", default_value="false", description="Show the arms in rviz"),
            ExecuteProcess(
                cmd=[LaunchConfiguration("program"), "run", LaunchConfiguration("scene"), "--ros"], output="both"
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", rviz],
                output="log",
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
