"""The state of a run, as plain data and numpy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from .pose import Pose
from .rotations import Array


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

    state["joint_collision"] is any quantity of docs/live_input.md as an array; KeyError if the arm does not report
    it.

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
        wrench_n_nm: Estimated force [N] and moment [N m] that the arm exerts on its environment, about K, in world
            axes; None if nothing estimates it.
        age_s: Age of this state when the loop used it [s].
        errors: Names of the arm's errors.
        reason: Why the arm stopped itself; empty if it did not.
        interventions: Cycles in which the safety stage changed a command, so far.
        last_intervention: Rule of the newest one.
        removed_by: Rule that took the arm from its last controllet; empty: it has one, or a request took it.
        gripper: State of its gripper; None without one.
        quantities: All that the arm reports, by name.
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
    removed_by: str
    gripper: GripperState | None
    quantities: Mapping[str, Array] = field(default_factory=dict, repr=False, compare=False)

    def __getitem__(self, name: str) -> Array:
        return self.quantities[name]

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


def _quantities(data: dict[str, Any]) -> dict[str, Array]:
    """Converts the numbers of an answer."""
    named = {name: value for name, value in data.items() if isinstance(value, (int, float, list)) and value != []}
    named |= {f"gripper_{name}": value for name, value in data.get("gripper", {}).items()}
    named.pop("error_names", None)
    return {name: np.atleast_1d(np.array(value, dtype=np.float64)) for name, value in named.items()}


def _arm_state(data: dict[str, Any], t_s: float) -> ArmState:
    named = {each.name: data[each.name] for each in fields(ArmState) if each.name in data}
    arrays = {name: np.array(value, dtype=np.float64) for name, value in named.items() if isinstance(value, list)}
    gripper = data.get("gripper")
    made: dict[str, Any] = {
        **{"wrench_n_nm": None, "reason": "", **named, **arrays, "t_s": t_s},
        "pose": Pose.measured(*(np.array(data[key], dtype=np.float64) for key in ("position_m", "quaternion_wxyz"))),
        "errors": tuple(data["error_names"]),
        "gripper": GripperState(**{each.name: gripper[each.name] for each in fields(GripperState)})
        if gripper
        else None,
        "quantities": _quantities(data),
    }
    return ArmState(**made)


def run_state(data: dict[str, Any]) -> RunState:
    """From the answer to the request `state`."""
    named = {each.name: data[each.name] for each in fields(RunState)}
    return RunState(**{**named, "arms": {arm["arm"]: _arm_state(arm, data["t_s"]) for arm in data["arms"]}})
