"""Converts arguments of a launch file to arms, and arms to descriptions and controllers.

Does not use ROS: strings in, plain data out.
"""

import math
import re
from dataclasses import dataclass

import yaml

from .controllets import controllets_for

KINDS = ("mujoco", "fci", "mock")
PAIR = [[0.0, 0.26, 0.0, 0.0, 0.0, 0.0], [0.0, -0.26, 0.0, 0.0, 0.0, 0.0]]
SQUARE = [
    [-0.4, 0.26, 0.0, 0.0, 0.0, 0.0],
    [-0.4, -0.26, 0.0, 0.0, 0.0, 0.0],
    [0.4, 0.26, 0.0, 0.0, 0.0, math.pi],
    [0.4, -0.26, 0.0, 0.0, 0.0, math.pi],
]


@dataclass
class Arm:
    name: str
    model: str
    hand: bool
    hardware: str  # one of KINDS
    address: str  # a real arm's address
    base: list  # x, y, z [m], roll, pitch, yaw [rad] of <name>_link0 in the world

    def joints(self):
        return [f"{self.name}_joint{i}" for i in range(1, 8)]


def _one_each(what, text, count):
    items = text.split()
    if len(items) == 1:
        items *= count
    if len(items) != count:
        raise ValueError(f"{what}: expected one value, or one for each of the {count} arms; found '{text}'")
    return items


def default_bases(count):
    """The same as in arms.urdf.xacro."""
    if count == 2:
        return PAIR
    if count == 4:
        return SQUARE
    return [[0.0, 0.6 * (i - 0.5 * (count - 1)), 0.0, 0.0, 0.0, 0.0] for i in range(count)]


def arms_from(arm_names, models="fer", hands="true", hardware="mujoco", addresses="none", bases=""):
    """Returns the arms that a launch file's arguments name. Raises ValueError with what was expected."""
    names = arm_names.split()
    count = len(names)
    if count == 0 or len(set(names)) != count:
        raise ValueError(f"arm_names: expected distinct names separated by spaces, found '{arm_names}'")
    places = yaml.safe_load(bases) if bases.strip() else None
    places = places or default_bases(count)
    if len(places) != count or any(not isinstance(p, list) or len(p) != 6 for p in places):
        raise ValueError("bases: expected [[x, y, z, roll, pitch, yaw], ...] in m and rad, one per arm")
    given = {"models": models, "hands": hands.lower(), "hardware": hardware, "addresses": addresses}
    columns = [_one_each(what, text, count) for what, text in given.items()]
    arms = []
    for name, model, hand, kind, address, place in zip(names, *columns, places):
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
            raise ValueError(f"arm_names: '{name}' is not a valid name (a letter, then letters, digits or _)")
        if kind not in KINDS:
            raise ValueError(f"hardware: expected {', '.join(KINDS)}, found '{kind}'")
        if hand not in ("true", "false"):
            raise ValueError(f"hands: expected true or false, found '{hand}'")
        if kind == "fci" and address == "none":
            raise ValueError(
                f"addresses: the real arm '{name}' needs the address of its controller, "
                "for example addresses:=172.16.0.2"
            )
        arms.append(Arm(name, model, hand == "true", kind, address, [float(x) for x in place]))
    return arms


def description_mappings(arms, scene="", ros2_control=True):
    """Returns the arguments of arms.urdf.xacro."""
    return {
        "arm_names": " ".join(a.name for a in arms),
        "models": " ".join(a.model for a in arms),
        "hands": " ".join(str(a.hand).lower() for a in arms),
        "hardware": " ".join(a.hardware for a in arms),
        "addresses": " ".join(a.address for a in arms),
        "bases": str([a.base for a in arms]),
        "scene": scene,
        "ros2_control": str(ros2_control).lower(),
    }


def renamed(data, names):
    """Returns the data with arms renamed: each old name, alone or followed by an underscore, is replaced."""
    pattern = re.compile(r"^(" + "|".join(map(re.escape, names)) + r")(?=_|$)")

    def word(text):
        return text if text == "arm_names" else pattern.sub(lambda m: names[m.group(1)], text)

    def walk(item):
        if isinstance(item, dict):
            return {word(key): walk(value) for key, value in item.items()}
        if isinstance(item, list):
            return [walk(value) for value in item]
        return word(item) if isinstance(item, str) else item

    return walk(data)


def controllers(data, arms):
    """Reads a controllers.yaml for these arms: (parameters, names that start, names that are only loaded).

    Its own arms, in their order, get the names of `arms`; the multimode controllers get the arms' models, and every law
    if the file lists no controllets.
    """
    its_own = data["controller_manager"]["ros__parameters"]["multipanda_arms"]
    if len(its_own) != len(arms):
        raise ValueError(f"controllers_file: found {len(its_own)} arms ({' '.join(its_own)}), expected {len(arms)}")
    data = renamed(data, dict(zip(its_own, (a.name for a in arms))))
    manager = data["controller_manager"]["ros__parameters"]
    manager.pop("multipanda_arms")
    started = manager.pop("multipanda_start")
    names = [name for name, value in manager.items() if isinstance(value, dict) and "type" in value]
    known = {a.name: a for a in arms}
    for section in data.values():
        parameters = section["ros__parameters"]
        if "arm_names" not in parameters:
            continue
        parameters.setdefault("controllets", controllets_for(parameters["arm_names"]))
        parameters["arms"] = {}
        for name in parameters["arm_names"]:
            arm = known[name]
            parameters["arms"][name] = {
                "model": arm.model,
                "hand": arm.hand,
                "base": {"position_m": arm.base[:3], "rpy_rad": arm.base[3:]},
            }
            if arm.hardware == "mock":  # mock hardware reports joints only
                parameters["arms"][name]["state_interfaces"] = ["position", "velocity", "effort"]
                parameters["arms"][name]["gravity_compensation"] = "robot"
    return data, started, [name for name in names if name not in started]


def moveit_parameters(data, arms):
    """Returns the parameters of move_group, from multipanda_moveit_config's arm.yaml."""
    kinematics, joint_limits, controller_map, planner_groups = {}, {}, {}, {}
    pipeline = data["planning"]["ompl"]
    for arm in arms:
        own = renamed({k: data[k] for k in ("kinematics", "controllers", "hand_controllers")}, {"arm": arm.name})
        kinematics.update(own["kinematics"])
        controller_map.update({name: dict(value, joints=arm.joints()) for name, value in own["controllers"].items()})
        if arm.hand and arm.hardware != "mock":
            controller_map.update(
                {
                    name: dict(value, joints=[f"{arm.name}_finger_joint1"])
                    for name, value in own["hand_controllers"].items()
                }
            )
        for joint, acceleration in zip(arm.joints(), data["joint_accelerations"][arm.model]):
            joint_limits[joint] = {"has_acceleration_limits": True, "max_acceleration": acceleration}
        planner_groups[f"{arm.name}_arm"] = {"planner_configs": list(pipeline["planner_configs"])}
    if len(arms) == 2:
        planner_groups["both_arms"] = {"planner_configs": list(pipeline["planner_configs"])}
    return {
        "robot_description_kinematics": kinematics,
        "robot_description_planning": {
            "joint_limits": joint_limits,
            "default_velocity_scaling_factor": data["default_velocity_scaling_factor"],
            "default_acceleration_scaling_factor": data["default_acceleration_scaling_factor"],
        },
        "planning_pipelines": data["planning"]["planning_pipelines"],
        "default_planning_pipeline": data["planning"]["default_planning_pipeline"],
        "ompl": {**pipeline, **planner_groups},
        "moveit_controller_manager": "moveit_simple_controller_manager/MoveItSimpleControllerManager",
        "moveit_simple_controller_manager": {"controller_names": list(controller_map), **controller_map},
        "publish_planning_scene": True,
        "publish_geometry_updates": True,
        "publish_state_updates": True,
        "publish_transforms_updates": True,
    }
