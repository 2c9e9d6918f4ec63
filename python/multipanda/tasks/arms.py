"""Observable states of arms: numbers that a real arm reports, of many worlds at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..rotations import Array, compose, conjugate, inverse, rotate
from ..state import ArmState


@dataclass(frozen=True)
class ArmStates:
    """The states of one arm in N worlds; row k belongs to world k. World axes, as in CONVENTIONS.md.

    Attributes:
        q_rad: Joint angles [rad], N x joints.
        dq_rad_per_s: Joint velocities [rad/s], N x joints.
        pose: X_WE: x y z [m], qw qx qy qz, N x 7.
        wrench_n_nm: F_K_W_est, force [N] and moment [N m] that the arm exerts, as estimated, N x 6.
        gripper: Its width [m], and 1 if something is grasped, N x 2; None without a gripper.
    """

    q_rad: Array
    dq_rad_per_s: Array
    pose: Array
    wrench_n_nm: Array
    gripper: Array | None = None

    @classmethod
    def of(cls, state: ArmState) -> ArmStates:
        """From the state that the client reads of a run: one world.

        An arm that estimates no wrench gets zeros.
        """
        wrench = state.wrench_n_nm if state.wrench_n_nm is not None else np.zeros(6)
        found = state.gripper
        gripper = None if found is None else np.array([[found.width_m, float(found.grasped)]])
        return cls(state.q_rad[None], state.dq_rad_per_s[None], state.pose.values[None], wrench[None], gripper)


States = Mapping[str, ArmStates]


def in_base(base: Array, pose: Array) -> Array:
    """A pose of the world in the frame of a base X_WB."""
    return compose(inverse(base), pose)


def wrench_in_base(base: Array, wrench: Array) -> Array:
    """A wrench in world axes, in the axes of a base."""
    back = conjugate(base[..., 3:])
    return np.concatenate([rotate(back, wrench[..., :3]), rotate(back, wrench[..., 3:])], axis=-1)
