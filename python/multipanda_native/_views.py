"""The numbers of worlds as numpy arrays, and how a world begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import core

Array = NDArray[np.float64]
POSE = 7


@dataclass(frozen=True)
class Arm:
    """The state of an arm: read-only views, of shape (n,) for a World and (worlds, n) for a Batch.

    arm["joint_collision"] is any quantity that shared records have of an arm, by its name there.

    Attributes:
        joints: How many joints it has.
        q_rad: Measured joint angles [rad].
        dq_rad_per_s: Measured joint velocities [rad/s].
        tau_J_nm: Measured joint torques [N m], with gravity.
        tau_J_d_nm: Commanded joint torques that are in use [N m], without gravity.
        X_WE: Pose of the end effector in the world: x y z [m], qw qx qy qz.
        F_K_W_est: Estimated force [N] and moment [N m] that the arm exerts, about K, in world axes.
        F_K_W_true: The same from the contacts of the simulation.
        gripper: Width between the fingers [m], whether it has grasped, whether it moves.
        held: 1 while the arm is held: no controllet of the scene owns it.
        quantities: All that there is, by name.
    """

    joints: int
    q_rad: Array
    dq_rad_per_s: Array
    tau_J_nm: Array
    tau_J_d_nm: Array
    X_WE: Array
    F_K_W_est: Array
    F_K_W_true: Array
    gripper: Array
    held: Array
    quantities: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.quantities[name]


def _shown(batch: Any, first: int, size: int, alone: bool) -> Array:
    view: Array = batch.view(first, size)
    view.flags.writeable = False
    return view[0] if alone else view


def arms_of(batch: Any, alone: bool) -> dict[str, Arm]:
    """The arms by name; `alone`: of the only world."""
    arms = {}
    for name, joints, fields in batch.arms:
        at = {field: _shown(batch, first, size, alone) for field, first, size in fields}
        same = {field: at[field] for field in ("q_rad", "dq_rad_per_s", "tau_J_nm", "tau_J_d_nm", "X_WE")}
        arms[name] = Arm(
            joints=joints,
            **same,
            F_K_W_est=at["wrench_n_nm"],
            F_K_W_true=at["contact_wrench_n_nm"],
            gripper=at["gripper"],
            held=at["held"],
            quantities=at,
        )
    return arms


def objects_of(batch: Any, alone: bool) -> dict[str, Array]:
    """The free objects' poses in the world by name."""
    return {name: _shown(batch, first, POSE, alone) for name, first in batch.objects}


def start_of(
    seed: int,
    hidden: bool,
    q_start_rad: Mapping[str, ArrayLike] | None,
    objects: Mapping[str, ArrayLike] | None,
    active: Sequence[str] | None,
) -> Any:
    """How one world begins, for the compiled part."""
    if not 0 <= seed < 2**64:
        raise ValueError(f"expected a seed from 0 to 2^64 - 1, found {seed}")
    start = core.WorldStart()
    start.seed, start.hidden = int(seed), bool(hidden)
    start.q_start = {name: np.asarray(q, dtype=np.float64).ravel().tolist() for name, q in (q_start_rad or {}).items()}
    start.objects = {name: np.asarray(x, dtype=np.float64).ravel().tolist() for name, x in (objects or {}).items()}
    start.active = None if active is None else list(active)
    return start
