"""The stand-alone program with its ROS interfaces, instead of a controller manager: it publishes description, joint
states and tf by itself.

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
    return LaunchDescription([
        DeclareLaunchArgument("program", default_value="multipanda", description="the program, if it is not on PATH"),
        DeclareLaunchArgument("scene", default_value="two_arms", description="name or file"),
        DeclareLaunchArgument("rviz", default_value="false", description="show the arms"),
        ExecuteProcess(cmd=[LaunchConfiguration("program"), "run", LaunchConfiguration("scene"), "--ros"], output="both"),
        Node(package="rviz2", executable="rviz2", arguments=["-d", rviz], output="log",
             condition=IfCondition(LaunchConfiguration("rviz"))),
    ])
