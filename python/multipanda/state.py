"""The state of a run, as plain data and numpy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A pose.

    Attributes:
        position_m: x, y, z [m].
        quaternion_wxyz: Orientation as unit quaternion w, x, y, z.
    """

    position_m: Array
    quaternion_wxyz: Array

    @classmethod
    def of(cls, values: Pose | Any) -> Pose:
        """From a Pose, seven numbers x y z qw qx qy qz [m], or a homogeneous 4 x 4 matrix.

        Raises:
            ValueError: It has another shape.
        """
        if isinstance(values, Pose):
            return values
        array = np.asarray(values, dtype=np.float64)
        if array.shape == (7,):
            return cls(array[:3].copy(), array[3:].copy())
        if array.shape == (4, 4):
            return cls(array[:3, 3].copy(), _quaternion(array[:3, :3]))
        raise ValueError(f"expected a Pose, 7 numbers x y z qw qx qy qz, or a 4 x 4 matrix; found shape {array.shape}")

    @property
    def rotation(self) -> Array:
        """The 3 x 3 rotation matrix."""
        w, x, y, z = self.quaternion_wxyz / np.linalg.norm(self.quaternion_wxyz)
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    @property
    def matrix(self) -> Array:
        """The homogeneous 4 x 4 matrix; translation [m]."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position_m
        return matrix

    @property
    def values(self) -> Array:
        """Seven numbers: x y z [m], qw qx qy qz."""
        return np.concatenate([self.position_m, self.quaternion_wxyz])

    def moved(self, x: float = 0, y: float = 0, z: float = 0) -> Pose:
        """The same orientation, moved along the axes of the frame in which this pose is [m]."""
        return Pose(self.position_m + np.array([x, y, z], dtype=np.float64), self.quaternion_wxyz)

    def angle_to(self, other: Pose) -> float:
        """The angle between both orientations [rad]."""
        a = self.quaternion_wxyz / np.linalg.norm(self.quaternion_wxyz)
        b = other.quaternion_wxyz / np.linalg.norm(other.quaternion_wxyz)
        return float(2 * np.arccos(min(1.0, abs(float(a @ b)))))


def _quaternion(r: Array) -> Array:
    """Quaternion of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix, exact for every rotation."""
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    quaternion = np.linalg.eigh(k)[1][:, -1]
    signed: Array = quaternion if quaternion[0] >= 0 else -quaternion
    return signed


@dataclass(frozen=True)
class GripperState:
    """The state of a hand or a vacuum gripper.

    Attributes:
        width_m: Distance between the fingers [m]; 0 of a vacuum gripper.
        max_width_m: Largest distance [m]; known after homing of a real hand.
        grasped: Whether something is held.
        moving: Whether the fingers move.
    """

    width_m: float
    max_width_m: float
    grasped: bool
    moving: bool


@dataclass(frozen=True)
class ArmState:
    """One arm at one cycle. Names and signs: CONVENTIONS.md.

    Attributes:
        arm: Name of the arm.
        t_s: Loop time [s].
        controllet: Name of the controllet that owns the arm; `<arm>_hold` while it is held.
        mode: Mode of the arm: `move`, `reflex`, `user_stopped`, ...
        stopped: Whether it is held until `resume()`.
        q_rad: Joint angles [rad].
        dq_rad_per_s: Joint velocities [rad/s].
        tau_J_nm: Measured joint torques [N m], with gravity.
        tau_cmd_nm: Commanded joint torques [N m], without gravity.
        pose: Pose of the end effector in the world [m].
        wrench_n_nm: Estimated force [N] and moment [N m] that the arm exerts on its environment, in world axes; None if
            nothing estimates it.
        age_s: Age of this state when the loop used it [s].
        errors: Names of the arm's errors.
        reason: Why the arm stopped itself; empty if it did not.
        interventions: Cycles in which the safety stage changed a command, so far.
        last_intervention: Rule of the newest one.
        gripper: State of its gripper; None without one.
    """

    arm: str
    t_s: float  # loop time
    controllet: str
    mode: str
    stopped: bool
    q_rad: Array
    dq_rad_per_s: Array
    tau_J_nm: Array
    tau_cmd_nm: Array
    pose: Pose
    wrench_n_nm: Array | None
    age_s: float
    errors: tuple[str, ...]
    reason: str
    interventions: int
    last_intervention: str
    gripper: GripperState | None

    @property
    def held(self) -> bool:
        """Whether the arm is held: owned by no controllet of the scene."""
        return self.controllet == f"{self.arm}_hold"


@dataclass(frozen=True)
class RunState:
    """All arms at one cycle.

    Attributes:
        scene: Name of the scene.
        cycle: Number of the cycle.
        t_s: Loop time [s].
        since_cycle_s: Age of the state when it was read, by the time that its cycle began [s].
        rate_hz: Cycles per second of wall time.
        cycle_us: Computing time of the cycle [us].
        overruns: Missed cycles, so far.
        arms: The arms by name.
    """

    scene: str
    cycle: int
    t_s: float
    since_cycle_s: float
    rate_hz: float
    cycle_us: float
    overruns: int
    arms: dict[str, ArmState]


def _arm_state(data: dict[str, Any], t_s: float) -> ArmState:
    def array(key: str) -> Array:
        return np.array(data[key], dtype=np.float64)

    gripper = data.get("gripper")
    return ArmState(
        arm=data["arm"],
        t_s=t_s,
        controllet=data["controllet"],
        mode=data["mode"],
        stopped=data["stopped"],
        q_rad=array("q_rad"),
        dq_rad_per_s=array("dq_rad_per_s"),
        tau_J_nm=array("tau_J_nm"),
        tau_cmd_nm=array("tau_cmd_nm"),
        pose=Pose(array("position_m"), array("quaternion_wxyz")),
        wrench_n_nm=array("wrench_n_nm") if "wrench_n_nm" in data else None,
        age_s=data["age_s"],
        errors=tuple(data["error_names"]),
        reason=data.get("reason", ""),
        interventions=data["interventions"],
        last_intervention=data["last_intervention"],
        gripper=GripperState(**gripper) if gripper else None,
    )


def run_state(data: dict[str, Any]) -> RunState:
    """From the answer to the request `state`."""
    return RunState(
        scene=data["scene"],
        cycle=data["cycle"],
        t_s=data["t_s"],
        since_cycle_s=data["since_cycle_s"],
        rate_hz=data["rate_hz"],
        cycle_us=data["cycle_us"],
        overruns=data["overruns"],
        arms={arm["arm"]: _arm_state(arm, data["t_s"]) for arm in data["arms"]},
    )
