"""Starts any number of arms under one controller manager: description, hardware, controllers and optionally rviz.

    ros2 launch multipanda_bringup arms.launch.py \\
        arm_names:="left right" hardware:="fci mujoco" addresses:="172.16.0.2 none"
"""

import os
import tempfile

import xacro
import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from multipanda_bringup.arms import arms_from, controllers, description_mappings

ARGUMENTS = {
    "arm_names": ("arm", "Names of the arms, separated by spaces"),
    "models": ("fer", "Model: fer, fr3 or fr3v2; one value for all arms, or one per arm"),
    "hands": ("true", "Whether arms have the gripper; one value for all arms, or one per arm"),
    "hardware": (
        "mujoco",
        "mujoco (simulated), fci (real or virtual arm) or mock; one value for all arms, or one per arm",
    ),
    "addresses": ("none", "Addresses of the real arms' controllers, one per arm; 'none' for simulated arms"),
    "bases": ("", "[[x, y, z, roll, pitch, yaw], ...] in m and rad (default: side by side)"),
    "scene": ("", "Scene file for the simulated arms, with its objects"),
    "controllers_file": (
        "",
        "Controllers (default: one_arm, two_arms, three_arms or four_arms.yaml of config, by the number of arms)",
    ),
    "rviz": ("false", "Show the arms in rviz"),
}


def set_up(context):
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    arms = arms_from(*(given[k] for k in ("arm_names", "models", "hands", "hardware", "addresses", "bases")))
    description = get_package_share_directory("multipanda_description")
    share = get_package_share_directory("multipanda_bringup")
    urdf = xacro.process_file(
        os.path.join(description, "urdf", "arms.urdf.xacro"), mappings=description_mappings(arms, given["scene"])
    ).toxml()
    file = given["controllers_file"]
    if not file:
        by_count = {1: "one_arm", 2: "two_arms", 3: "three_arms", 4: "four_arms"}
        if len(arms) not in by_count:
            raise ValueError(
                f"controllers_file: no default for {len(arms)} arms; write a file like {share}/config/two_arms.yaml"
            )
        file = os.path.join(share, "config", by_count[len(arms)] + ".yaml")
    with open(file, encoding="utf-8") as stream:
        parameters, started, loaded = controllers(yaml.safe_load(stream), arms)
    written = os.path.join(tempfile.mkdtemp(prefix="multipanda_"), "controllers.yaml")
    with open(written, "w", encoding="utf-8") as stream:
        yaml.safe_dump(parameters, stream)

    # Humble's controller manager takes the description from a parameter, later versions from the topic.
    manager_parameters = (
        [{"robot_description": urdf}, written] if os.environ.get("ROS_DISTRO") == "humble" else [written]
    )
    nodes = [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            output="both",
            parameters=[{"robot_description": urdf}],
        ),
        Node(
            package="controller_manager",
            executable="ros2_control_node",
            output="both",
            parameters=manager_parameters,
            remappings=[("~/robot_description", "robot_description")],
        ),
        Node(
            package="controller_manager",
            executable="spawner",
            output="both",
            arguments=[*started, "--param-file", written],
        ),
    ]
    if loaded:
        nodes.append(
            Node(
                package="controller_manager",
                executable="spawner",
                output="both",
                arguments=[*loaded, "--inactive", "--param-file", written],
            )
        )
    for arm in arms:  # tf also needs the finger joints, published by the hardware's node
        if arm.hand and arm.hardware != "mock":
            nodes.append(
                Node(
                    package="topic_tools",
                    executable="relay",
                    name=f"{arm.name}_finger_states",
                    output="both",
                    arguments=[f"{arm.name}_gripper/joint_states", "joint_states"],
                )
            )
    if given["rviz"].lower() == "true":
        nodes.append(
            Node(
                package="rviz2",
                executable="rviz2",
                output="log",
                arguments=["-d", os.path.join(description, "rviz", "arms.rviz")],
            )
        )
    return nodes


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=set_up)])
