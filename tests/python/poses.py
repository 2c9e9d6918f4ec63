"""Rotations and poses as matrices, made another way than the package makes them."""

import math

import numpy as np


def rodrigues(vector):
    """The rotation matrix of a rotation vector, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def homogeneous(rotation, position):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def random_pose(random):
    """A pose as seven numbers and as a matrix."""
    from multipanda import Pose

    matrix = homogeneous(rodrigues(random.normal(size=3)), random.normal(size=3))
    return Pose.of(matrix).values, matrix
