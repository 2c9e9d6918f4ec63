"""Names and numbers of features: the same for a connected robot and for a data set made from logs.

Poses are in the frame of the arm's base, wrenches in its axes about K: a policy does not depend on where an arm is
mounted.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..rotations import Array, compose
from ..state import ArmState
from ..tasks.arms import in_base, wrench_in_base

ACTIONS = ("joints", "pose")
OBSERVED = ("joints", "velocities", "torques", "pose", "wrench")

_OF_JOINTS = {"joints": "pos", "velocities": "vel", "torques": "torque"}
_OF_HAND = {"pose": ("x", "y", "z", "qw", "qx", "qy", "qz"), "wrench": ("fx", "fy", "fz", "mx", "my", "mz")}


def quantity_names(arm: str, quantity: str, joints: int = 7) -> list[str]:
    """The names of one quantity of an arm: left_joint1.pos [rad], left_ee.x [m], ...

    Args:
        arm: Its name.
        quantity: One of OBSERVED.
        joints: How many joints it has.

    Raises:
        ValueError: There is no such quantity.
    """
    if quantity in _OF_JOINTS:
        return [f"{arm}_joint{k}.{_OF_JOINTS[quantity]}" for k in range(1, joints + 1)]
    if quantity in _OF_HAND:
        return [f"{arm}_ee.{part}" for part in _OF_HAND[quantity]]
    raise ValueError(f"expected one of {', '.join(OBSERVED)}, found {quantity!r}")


def gripper_name(arm: str) -> str:
    """The name of the distance between an arm's fingers [m]."""
    return f"{arm}_gripper.pos"


def state_names(arms: Iterable[str], observed: Sequence[str], grippers: Iterable[str], joints: int = 7) -> list[str]:
    """The names of an observation, arm by arm. Raises ValueError for an unknown quantity."""
    found, hands = [], set(grippers)
    for arm in arms:
        for quantity in observed:
            found += quantity_names(arm, quantity, joints)
        found += [gripper_name(arm)] * (arm in hands)
    return found


def action_names(arms: Iterable[str], action: str, grippers: Iterable[str], joints: int = 7) -> list[str]:
    """The names of an action, arm by arm. Raises ValueError for an unknown kind."""
    if action not in ACTIONS:
        raise ValueError(f"action: expected one of {', '.join(ACTIONS)}, found {action!r}")
    return state_names(arms, [action], grippers, joints)


def state_values(state: ArmState, base: Array, quantity: str) -> Array:
    """The numbers of a quantity, in the order of quantity_names(). `base`: X_WB, x y z [m], qw qx qy qz."""
    if quantity == "joints":
        return state.q_rad
    if quantity == "velocities":
        return state.dq_rad_per_s
    if quantity == "torques":
        return state.tau_J_nm
    if quantity == "pose":
        return in_base(base, state.pose.values)
    if state.wrench_n_nm is None:
        return np.full(6, np.nan)
    return wrench_in_base(base, state.wrench_n_nm)


def in_world(base: Array, pose: Array) -> Array:
    """A pose in the frame of a base X_WB, in the world."""
    return compose(base, pose)


class SteadySigns:
    """Quaternions without jumps of their sign: q and -q are one orientation, but two inputs of a policy.

    The largest part of an arm's first one is positive; each later one has the sign closer to the previous one.
    """

    def __init__(self) -> None:
        self._last: dict[str, Array] = {}

    def of(self, key: str, pose: Array) -> Array:
        """The same pose, x y z [m], qw qx qy qz."""
        last = self._last.get(key)
        quaternion = pose[3:]
        sign = quaternion[np.argmax(np.abs(quaternion))] if last is None else quaternion @ last
        steady = quaternion if sign >= 0 else -quaternion
        self._last[key] = steady
        return np.concatenate([pose[:3], steady])
