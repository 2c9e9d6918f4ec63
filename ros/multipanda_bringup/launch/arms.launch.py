"""Starts any number of arms under one controller manager: description, hardware, controllers and optionally rviz.

    ros2 launch multipanda_bringup arms.launch.py \\
        arm_names:="left right" hardware:="fci mujoco" addresses:="172.16.0.2 none"
"""

import os
import tempfile

import xacro
import yaml
from ament_index_python.packages import get_package_share_directory
from launch_ros.actions import Node
from multipanda_bringup.arms import arms_from, controllers, description_mappings
from multipanda_bringup.launching import SHARE, launched, rviz

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


def node(package, executable, **options):
    return Node(package=package, executable=executable, output="both", **options)


def set_up(given):
    arms = arms_from(*(given[k] for k in ("arm_names", "models", "hands", "hardware", "addresses", "bases")))
    description = get_package_share_directory("multipanda_description")
    urdf = xacro.process_file(
        os.path.join(description, "urdf", "arms.urdf.xacro"), mappings=description_mappings(arms, given["scene"])
    ).toxml()
    file = given["controllers_file"]
    if not file:
        by_count = {1: "one_arm", 2: "two_arms", 3: "three_arms", 4: "four_arms"}
        if len(arms) not in by_count:
            raise ValueError(
                f"controllers_file: no default for {len(arms)} arms; write a file like {SHARE}/config/two_arms.yaml"
            )
        file = os.path.join(SHARE, "config", by_count[len(arms)] + ".yaml")
    with open(file, encoding="utf-8") as stream:
        parameters, started, loaded = controllers(yaml.safe_load(stream), arms)
    written = os.path.join(tempfile.mkdtemp(prefix="multipanda_"), "controllers.yaml")
    with open(written, "w", encoding="utf-8") as stream:
        yaml.safe_dump(parameters, stream)

    described = [{"robot_description": urdf}]
    # Humble's controller manager takes the description from a parameter, later versions from the topic.
    of_manager = [*(described if os.environ.get("ROS_DISTRO") == "humble" else []), written]
    from_topic = [("~/robot_description", "robot_description")]
    nodes = [
        node("robot_state_publisher", "robot_state_publisher", parameters=described),
        node("controller_manager", "ros2_control_node", parameters=of_manager, remappings=from_topic),
    ]
    for names in (started, [*loaded, "--inactive"]) if loaded else (started,):
        nodes.append(node("controller_manager", "spawner", arguments=[*names, "--param-file", written]))
    for arm in arms:  # tf also needs the finger joints, published by the hardware's node
        if arm.hand and arm.hardware != "mock":
            topics = [f"{arm.name}_gripper/joint_states", "joint_states"]
            nodes.append(node("topic_tools", "relay", name=f"{arm.name}_finger_states", arguments=topics))
    return nodes + rviz(given, os.path.join(description, "rviz", "arms.rviz"))


def generate_launch_description():
    return launched(ARGUMENTS, set_up)
