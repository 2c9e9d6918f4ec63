"""Converts an operator's deflection to a moving target of one hand: speed, force limit, lead over the hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .pose import Pose
from .rotations import Array, exponential, logarithm, multiply, normalized

_LONGEST_STEP_S = 0.05  # the period of the slowest rate; a busy computer catches up no more than that at once


@dataclass(frozen=True)
class JogLimits:
    """Limits of a hand's motion by a device.

    Attributes:
        speed_m_per_s: Speed at full deflection [m/s].
        turn_rad_per_s: Angular velocity at full deflection [rad/s].
        force_n: Force on the environment above which the target does not press further [N].
        lead_m: Largest distance of the target to the hand [m], against windup of a hand that is held back.
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
    """Removes the part of a velocity [m/s] that would press further where the hand already presses [N].

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

    `hand` is the hand's pose, `force` the force that it exerts [N], both in world axes.
    """
    step = min(max(step_s, 0.0), _LONGEST_STEP_S)
    linear = force_limited(limits.speed_m_per_s * _bounded(twist[:3], 1), force, limits.force_n)
    turned = multiply(exponential(step * limits.turn_rad_per_s * _bounded(twist[3:], 1)), target.quaternion_wxyz)
    return within_lead(Pose(target.position_m + step * linear, normalized(turned)), hand, limits)


def within_lead(target: Pose, hand: Pose, limits: JogLimits) -> Pose:
    """The nearest pose to the target that is not too far ahead of the hand."""
    position = hand.position_m + _bounded(target.position_m - hand.position_m, limits.lead_m)
    if target.angle_to(hand) <= limits.lead_rad:
        return Pose(position, target.quaternion_wxyz)
    angle = logarithm((target @ hand.inverse()).quaternion_wxyz)
    return Pose(position, multiply(exponential(_bounded(angle, limits.lead_rad)), hand.quaternion_wxyz))


def _bounded(vector: Array, most: float) -> Array:
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)
