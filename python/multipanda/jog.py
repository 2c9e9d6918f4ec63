"""From what an operator's device says to a moving target of one hand: speed, force limit, lead on the hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .state import Array, Pose

_LONGEST_STEP_S = 0.1


@dataclass(frozen=True)
class JogLimits:
    """How fast and how hard a device leads a hand.

    Attributes:
        speed_m_per_s: Speed at full deflection [m/s].
        turn_rad_per_s: Angular velocity at full deflection [rad/s].
        force_n: Force on the environment above which the target does not press further [N].
        lead_m: Largest distance of the target to the hand [m], so that a hand that is held back does not wind up.
        lead_rad: Largest angle between both [rad].
    """

    speed_m_per_s: float = 0.1
    turn_rad_per_s: float = 0.4
    force_n: float = 20
    lead_m: float = 0.04
    lead_rad: float = 0.15

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}: expected a number above 0, found {value}")


def shaped(deflection: Any, dead_zone: float = 0.12, exponent: float = 1.7) -> Array:
    """Removes the dead zone of each axis and bends the rest: fine near the middle, full speed at the end."""
    values = np.asarray(deflection, dtype=np.float64)
    beyond = np.clip((np.abs(values) - dead_zone) / (1 - dead_zone), 0, 1)
    bent: Array = np.sign(values) * beyond**exponent
    return bent


def axes_rotation(axes: str, base: Pose, hand: Pose) -> Array:
    """Rotation from the device's axes (right, away from the operator, up) to the world's.

    `base`: away is the base's x, by its heading only: up on the device is up in the world. `hand`: the hand's own axes.
    """
    if axes == "hand":
        return hand.rotation
    forward = base.rotation[:, 0]
    heading = np.arctan2(forward[1], forward[0]) - np.pi / 2
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def force_limited(velocity: Array, force: Array, limit_n: float) -> Array:
    """Without the part of a velocity [m/s] that presses further where the hand already presses [N].

    It fades between half of the limit and all of it. `force` is what the arm exerts on its environment.
    """
    pressed = float(np.linalg.norm(force))
    if not pressed > limit_n / 2:
        return velocity
    direction = force / pressed
    into = float(velocity @ direction)
    if into <= 0:
        return velocity
    result: Array = velocity - direction * into * min(1.0, (pressed - limit_n / 2) / (limit_n / 2))
    return result


def jogged(target: Pose, twist: Array, step_s: float, hand: Pose, force: Array, limits: JogLimits) -> Pose:
    """The target after a step [s]. `twist`: deflection in world axes, linear first, -1 to 1.

    `hand` is where the hand is, `force` what it exerts [N], both in world axes.
    """
    step = min(max(step_s, 0.0), _LONGEST_STEP_S)
    linear = force_limited(limits.speed_m_per_s * _bounded(twist[:3], 1), force, limits.force_n)
    turned = _times(_exponential(step * limits.turn_rad_per_s * _bounded(twist[3:], 1)), target.quaternion_wxyz)
    return within_lead(Pose(target.position_m + step * linear, turned / np.linalg.norm(turned)), hand, limits)


def within_lead(target: Pose, hand: Pose, limits: JogLimits) -> Pose:
    """The nearest pose to the target that is not too far ahead of the hand."""
    position = hand.position_m + _bounded(target.position_m - hand.position_m, limits.lead_m)
    inverse = hand.quaternion_wxyz * np.array([1, -1, -1, -1])
    angle = _logarithm(_times(target.quaternion_wxyz, inverse))
    if float(np.linalg.norm(angle)) <= limits.lead_rad:
        return Pose(position, target.quaternion_wxyz)
    turned = _times(_exponential(_bounded(angle, limits.lead_rad)), hand.quaternion_wxyz)
    return Pose(position, turned / np.linalg.norm(turned))


def _bounded(vector: Array, most: float) -> Array:
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)


def _times(a: Array, b: Array) -> Array:
    """Product of quaternions w, x, y, z."""
    product: Array = np.concatenate(
        [[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])]
    )
    return product


def _exponential(rotation: Array) -> Array:
    half = 0.5 * float(np.linalg.norm(rotation))
    return np.concatenate([[np.cos(half)], 0.5 * np.sinc(half / np.pi) * rotation])


def _logarithm(quaternion: Array) -> Array:
    """Rotation vector [rad] of at most pi."""
    q = quaternion if quaternion[0] >= 0 else -quaternion
    sine = float(np.linalg.norm(q[1:]))
    result: Array = q[1:] * (2 if sine < 1e-12 else 2 * np.arctan2(sine, q[0]) / sine)
    return result
