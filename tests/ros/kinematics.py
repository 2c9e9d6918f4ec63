"""Forward kinematics of a URDF directly from its text, to check poses that were computed in another way."""

import xml.etree.ElementTree as ET

import numpy as np


def rpy(roll, pitch, yaw):
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation(axis, angle):
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def transform(R, p):
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def of_quaternion(q):
    w, x, y, z = q.w, q.x, q.y, q.z
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def of_pose(pose):
    return transform(of_quaternion(pose.orientation), [pose.position.x, pose.position.y, pose.position.z])


def of_transform(message):
    t = message.transform
    return transform(of_quaternion(t.rotation), [t.translation.x, t.translation.y, t.translation.z])


class Robot:
    """The links of a URDF at joint positions: link(name, {joint: position}) is the pose in the root."""

    def __init__(self, text):
        numbers = lambda node, key, default: np.array([float(x) for x in (node.get(key) or default).split()])  # noqa: E731
        self.joints = {}
        for joint in ET.fromstring(text).iter("joint"):
            if joint.find("child") is None:
                continue
            origin, axis = joint.find("origin"), joint.find("axis")
            X = np.eye(4)
            if origin is not None:
                X = transform(rpy(*numbers(origin, "rpy", "0 0 0")), numbers(origin, "xyz", "0 0 0"))
            self.joints[joint.find("child").get("link")] = (
                joint.find("parent").get("link"),
                joint.get("name"),
                joint.get("type"),
                X,
                numbers(axis, "xyz", "1 0 0") if axis is not None else np.array([1.0, 0, 0]),
            )

    def link(self, name, positions):
        X = np.eye(4)
        while name in self.joints:
            name, joint, kind, X_PJ, axis = self.joints[name]
            motion = np.eye(4)
            if kind in ("revolute", "continuous"):
                motion = transform(rotation(axis, positions[joint]), np.zeros(3))
            elif kind == "prismatic":
                motion = transform(np.eye(3), axis * positions[joint])
            X = X_PJ @ motion @ X
        return X
