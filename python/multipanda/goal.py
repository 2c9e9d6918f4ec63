"""A goal that was sent, and its arrival."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import Refused, Timeout
from .state import ArmState, Pose

if TYPE_CHECKING:
    from .controllet import Controllet

_PERIOD_S = 0.01  # between two looks at the state


class Goal:
    """A goal for an input of a controllet, which the loop has accepted.

    Attributes:
        controllet: The controllet.
        spec: The input: its entry in `Controllet.inputs`.
        arm: Name of the arm that the input moves.
        values: The numbers that were sent, in SI units: [m] and quaternion, or [rad].
        frame: `world` or `<arm>_base`.
        accepted_at_s: Loop time of the cycle that took it [s].
    """

    def __init__(
        self, controllet: Controllet, spec: dict[str, Any], values: list[float], frame: str, accepted_at_s: float
    ) -> None:
        self.controllet, self.spec, self.frame, self.accepted_at_s = controllet, spec, frame, accepted_at_s
        self.values = np.array(values)
        self.arm: str = spec["arm"]

    def error(self, state: ArmState) -> tuple[float, float]:
        """Distance [m] and angle [rad] to a pose; 0 and the largest angle of a joint [rad] to joint angles.

        Raises:
            ValueError: The input is neither a pose nor joint angles.
        """
        if self.spec["quantity"] == "joints":
            return 0.0, float(np.max(np.abs(state.q_rad - self.values)))
        if self.spec["quantity"] != "pose":
            raise ValueError(f"a {self.spec['quantity']} is not a place: there is nothing to wait for")
        goal = Pose.of(self.values)
        if self.frame != "world":
            goal = Pose.of(self.controllet.client.arms[self.frame.removesuffix("_base")].base.matrix @ goal.matrix)
        return float(np.linalg.norm(state.pose.position_m - goal.position_m)), state.pose.angle_to(goal)

    def wait(
        self,
        timeout_s: float = 30,
        *,
        position_m: float = 0.01,
        angle_rad: float = 0.03,
        speed_rad_per_s: float = 0.02,
    ) -> ArmState:
        """Waits until the arm is within the tolerances and at rest.

        Args:
            timeout_s: How long to wait [s].
            position_m: Largest distance [m].
            angle_rad: Largest angle [rad], of the hand or of a joint.
            speed_rad_per_s: Largest speed of a joint [rad/s] that counts as rest.

        Returns:
            The state of the arm at its goal.

        Raises:
            Timeout: It is not there in time, with the distance that is left: something may be in the way.
            Refused: The controllet lost the arm: by a stop, a reflex, another switch, or the safety stage.
            Disconnected: The run has ended.
            ValueError: The controllet moves several arms, and its pose is that of no hand: wait by `run.state()`.
        """
        if len(self.controllet.arms) != 1:
            raise ValueError(f"{self.controllet.name} moves {', '.join(self.controllet.arms)}: wait by run.state()")
        deadline = time.monotonic() + timeout_s
        arm = self.controllet.client.arms[self.arm]
        while True:
            state = arm.state
            distance, angle = self.error(state)
            if state.controllet != self.controllet.name:
                why = state.reason or state.last_intervention or "another switch or a stop"
                raise Refused(
                    "not_active",
                    f"{self.controllet.name} lost {self.arm}, which {state.controllet} owns now: {why}",
                    "read the state of the arm, then switch again",
                )
            still = float(np.max(np.abs(state.dq_rad_per_s))) <= speed_rad_per_s
            if still and distance <= position_m and angle <= angle_rad and state.t_s > self.accepted_at_s:
                return state
            if time.monotonic() >= deadline:
                raise Timeout(
                    f"{self.arm} is {1e3 * distance:.1f} mm and {angle:.3f} rad away from its goal "
                    f"after {timeout_s:g} s",
                    "see whether something is in the way, or wait with a larger tolerance",
                )
            time.sleep(_PERIOD_S)
