"""Starts MoveIt's move_group for one or two arms that are already running.

The arms run either under ros2_control with their trajectory controllers active
(`ros2 control switch_controllers --activate left_arm_controller ...`), or in the stand-alone program with a joint
impedance active on each arm. Both serve <arm>_arm_controller/follow_joint_trajectory.

    ros2 launch multipanda_bringup dual.launch.py
    ros2 launch multipanda_moveit_config moveit.launch.py arm_names:="left right" rviz:=true
"""

import os

import xacro
import yaml
from ament_index_python.packages import get_package_share_directory
from launch_ros.actions import Node
from multipanda_bringup.arms import arms_from, description_mappings, moveit_parameters
from multipanda_bringup.launching import launched, rviz

ARGUMENTS = {
    "arm_names": ("arm", "One or two names"),
    "models": ("fer", "As in multipanda_bringup"),
    "hands": ("true", "As in multipanda_bringup"),
    "bases": ("", "As in multipanda_bringup"),
    "use_sim_time": ("false", "Use /clock; for arms that the stand-alone program simulates"),
    "rviz": ("false", "Start rviz with MoveIt's panel"),
}


def set_up(given):
    arms = arms_from(given["arm_names"], given["models"], given["hands"], bases=given["bases"])
    description = get_package_share_directory("multipanda_description")
    config = os.path.join(get_package_share_directory("multipanda_moveit_config"), "config")
    mappings = description_mappings(arms, ros2_control=False)
    urdf = xacro.process_file(os.path.join(description, "urdf", "arms.urdf.xacro"), mappings=mappings).toxml()
    srdf = xacro.process_file(
        os.path.join(config, "arms.srdf.xacro"),
        mappings={"description": description, **{name: mappings[name] for name in ("arm_names", "models", "hands")}},
    ).toxml()
    with open(os.path.join(config, "arm.yaml"), encoding="utf-8") as stream:
        parameters = moveit_parameters(yaml.safe_load(stream), arms)
    if os.environ.get("ROS_DISTRO") == "humble":  # Humble needs one string and supports only these
        parameters["ompl"]["request_adapters"] = " ".join(
            "default_planner_request_adapters/" + name
            for name in (
                "AddTimeOptimalParameterization",
                "ResolveConstraintFrames",
                "FixWorkspaceBounds",
                "FixStartStateBounds",
                "FixStartStateCollision",
                "FixStartStatePathConstraints",
            )
        )
        parameters["ompl"].pop("response_adapters")
    parameters.update(
        robot_description=urdf, robot_description_semantic=srdf, use_sim_time=given["use_sim_time"].lower() == "true"
    )
    group = Node(package="moveit_ros_move_group", executable="move_group", output="both", parameters=[parameters])
    return [group, *rviz(given, os.path.join(config, "moveit.rviz"), parameters=[parameters])]


def generate_launch_description():
    return launched(ARGUMENTS, set_up)
