"""Poses and unit quaternions (w, x, y, z) of many worlds at once: arrays whose last axis holds the numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def multiply(a: Array, b: Array) -> Array:
    """The product a b of quaternions."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(a: Array) -> Array:
    """The inverse of a unit quaternion."""
    turned_back: Array = a * np.array([1.0, -1.0, -1.0, -1.0])
    return turned_back


def rotate(quaternion: Array, vector: Array) -> Array:
    """The vector, turned by a unit quaternion."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    twice = 2 * np.cross(u, vector)
    turned: Array = vector + w * twice + np.cross(u, twice)
    return turned


def exponential(rotation_vector: Array) -> Array:
    """The quaternion of a rotation vector [rad]."""
    angle = np.linalg.norm(rotation_vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * rotation_vector], axis=-1)


def logarithm(quaternion: Array) -> Array:
    """The rotation vector of a unit quaternion, at most pi long [rad]."""
    q = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    factor = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0)
    vector: Array = factor * q[..., 1:]
    return vector


def normalized(quaternion: Array) -> Array:
    """The quaternion with length 1."""
    unit: Array = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return unit


def from_rpy(rpy: Array) -> Array:
    """The quaternion of roll, pitch and yaw about fixed axes [rad]: Rz(yaw) Ry(pitch) Rx(roll)."""
    half = np.asarray(rpy, dtype=np.float64) / 2
    zero = np.zeros_like(half[..., 0])
    x = np.stack([np.cos(half[..., 0]), np.sin(half[..., 0]), zero, zero], axis=-1)
    y = np.stack([np.cos(half[..., 1]), zero, np.sin(half[..., 1]), zero], axis=-1)
    z = np.stack([np.cos(half[..., 2]), zero, zero, np.sin(half[..., 2])], axis=-1)
    return multiply(z, multiply(y, x))


def compose(a: Array, b: Array) -> Array:
    """The pose a b; a pose is x y z [m], qw qx qy qz."""
    position = a[..., :3] + rotate(a[..., 3:], b[..., :3])
    return np.concatenate([position, multiply(a[..., 3:], b[..., 3:])], axis=-1)


def inverse(a: Array) -> Array:
    """The inverse of a pose."""
    turned = conjugate(a[..., 3:])
    return np.concatenate([-rotate(turned, a[..., :3]), turned], axis=-1)


def matrix(quaternion: Array) -> Array:
    """The 3 x 3 rotation matrix of a unit quaternion."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def from_matrix(r: Array) -> Array:
    """The quaternion of one rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix, exact for every one."""
    k = np.zeros((4, 4))
    k[0] = [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    k[1:, 0], k[1:, 1:] = k[0, 1:], r + r.T - np.trace(r) * np.eye(3)
    quaternion: Array = np.linalg.eigh(k)[1][:, -1]
    return quaternion if quaternion[0] >= 0 else -quaternion


def to_rpy(quaternion: Array) -> Array:
    """Roll, pitch and yaw about fixed axes [rad] of one unit quaternion; where only a sum of two counts, roll is 0."""
    r = matrix(quaternion)
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    if abs(r[2, 0]) > 1 - 1e-12:
        return np.array([0.0, pitch, np.arctan2(-r[0, 1], r[1, 1])])
    return np.array([np.arctan2(r[2, 1], r[2, 2]), pitch, np.arctan2(r[1, 0], r[0, 0])])


def axes(quaternion: Array) -> Array:
    """The first two columns of the rotation matrix: six numbers that are continuous over all orientations."""
    r = matrix(quaternion)
    return np.concatenate([r[..., 0], r[..., 1]], axis=-1)
