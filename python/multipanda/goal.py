"""A goal that was sent, and its arrival."""

from __future__ import annotations

import contextlib
import time
from typing import Any

import numpy as np

from .errors import Refused, Timeout
from .instance import Instance
from .pose import Pose
from .rotations import Array
from .state import ArmState

_PERIOD_S = 0.01  # polling period
_PEAK = 1.875  # greatest speed of a quintic between rests, over its mean
_FOLLOWS_M, _FOLLOWS_RAD = 0.03, 0.1  # an arm farther behind its set-point is held back
_THERE_M, _THERE_RAD = 1e-4, 1e-4  # of a set-point that has arrived


class Goal:
    """A goal for an input of a controllet, which the loop has accepted.

    Attributes:
        controllet: The controllet.
        spec: The input: its entry in `Controllet.inputs`.
        arm: Name of the arm that the input moves.
        values: The numbers that were sent, in SI units: [m] and quaternion, or [rad].
        frame: `world` or `<arm>_base`.
        accepted_at_s: Loop time of the cycle that took it [s].
        shortest_s: Duration of its motion from rest, as its speed limit and duration_s allow [s]; limits of
            acceleration, and that of the hand of joint goals, may stretch it. None where it is not known.
        bounded_by: What makes it so long: `duration_s`, or a limit with its unit.
    """

    def __init__(
        self,
        controllet: Instance,
        spec: dict[str, Any],
        values: list[float],
        frame: str,
        accepted_at_s: float,
        duration_s: float | None = None,
        until: bool = False,
    ) -> None:
        self.controllet, self.spec, self.frame, self.accepted_at_s = controllet, spec, frame, accepted_at_s
        self.values = np.array(values)
        self.arm: str = spec["arm"]
        self._until = until
        self.shortest_s, self.bounded_by = self._bounds(duration_s or 0)

    @property
    def ended_by(self) -> str:
        """What ended it early: `force_n`, `torque_nm` or `distance_m`; empty: nothing so far."""
        client, begins = self.controllet.client, f"{self.controllet.name}.{self.spec['name']} ended by "
        if not self._until:
            return ""
        for event in client.newest_events(client.shared(), self.accepted_at_s):
            if event["kind"] == "goal_ended" and event["text"].startswith(begins):
                return str(event["text"].removeprefix(begins).split()[0])
        return ""

    def _bounds(self, duration_s: float) -> tuple[float | None, str]:
        if self.spec["quantity"] not in ("pose", "joints"):
            return None, ""
        try:
            found = self.controllet.client.record()[f"{self.controllet.name}/{self.spec['name']}"]
        except Refused:  # no shared records
            return None, ""
        if not np.all(np.isfinite(found)):  # no longer active
            return None, ""
        distance, angle = self._away(found)
        speed, turn = self.spec["max_speed"], self.spec["max_angular_speed"]
        if self.spec["quantity"] == "joints":
            turn = speed
        reasons = {"duration_s": duration_s, f"{speed:g} m/s": _PEAK * distance / speed}
        reasons[f"{turn:g} rad/s"] = _PEAK * angle / turn
        longest = max(reasons, key=lambda reason: reasons[reason])
        return reasons[longest], longest

    def error(self, state: ArmState) -> tuple[float, float]:
        """Distance [m] and angle [rad] to a pose; 0 and the largest angle of a joint [rad] to joint angles.

        Of a controllet of several arms, whose pose need not be that of a hand: those of the loop's set-point.

        Raises:
            ValueError: The input is neither a pose nor joint angles.
            Refused: The controllet has several arms, and the run shares no records.
        """
        quantity, client = self.spec["quantity"], self.controllet.client
        if quantity not in ("pose", "joints"):
            raise ValueError(f"a {quantity} has no position: there is nothing to wait for")
        found = state.q_rad if quantity == "joints" else state.pose.values
        if len(self.controllet.arms) > 1:
            found = client.record()[f"{self.controllet.name}/{self.spec['name']}"]
        return self._away(found)

    def _away(self, found: Array) -> tuple[float, float]:
        if self.spec["quantity"] == "joints":
            return 0.0, float(np.max(np.abs(found - self.values)))
        goal = Pose.of(self.values)
        if self.frame != "world":
            goal = self.controllet.client.base(self.frame.removesuffix("_base")) @ goal
        reached = Pose.measured(found[:3], found[3:])
        return goal.distance_to(reached), goal.angle_to(reached)

    def _late(self, state: ArmState, timeout_s: float) -> Timeout:
        """Why the arm is late: its set-point of the same cycle shows whether speed limits are the cause."""
        client, found = self.controllet.client, None
        with contextlib.suppress(Refused):  # the run shares no records
            record = client.record()
            state, found = record.arm(self.arm), record[f"{self.controllet.name}/{self.spec['name']}"]
        distance, angle = self.error(state)
        said = f"{self.arm} is {1e3 * distance:.1f} mm and {angle:.3f} rad away from its goal after {timeout_s:g} s"
        if found is None:
            return Timeout(said, "the motion may take longer than requested, or something is in the way")
        left, turn = self._away(found)
        said += f", its set-point {1e3 * left:.1f} mm and {turn:.3f} rad"
        if distance - left > _FOLLOWS_M or angle - turn > _FOLLOWS_RAD:
            why = "something is in the way, the goal is beyond its reach or a joint's range, or a load is not declared"
            return Timeout(said, f"the arm does not follow: {why}")
        if left > _THERE_M or turn > _THERE_RAD:
            least = "" if self.shortest_s is None else f" ({self.bounded_by}: {self.shortest_s:.1f} s at least)"
            return Timeout(said, f"the motion takes longer than requested, within its limits{least}: wait longer")
        return Timeout(said, "the arm rests short of its set-point, or is not at rest: a load, friction, tolerances")

    def wait(
        self,
        timeout_s: float = 30,
        *,
        position_m: float = 0.01,
        angle_rad: float = 0.03,
        speed_rad_per_s: float = 0.02,
    ) -> ArmState:
        """Waits until the arm is within the tolerances and at rest; all of its arms, if the controllet has several.

        A goal that its `until` has ended counts as reached where the arm comes to rest; see `ended_by`.

        Args:
            timeout_s: How long to wait [s].
            position_m: Largest distance [m].
            angle_rad: Largest angle [rad], of the hand or of a joint.
            speed_rad_per_s: Largest speed of a joint [rad/s] that counts as rest.

        Returns:
            The state of the arm at its goal.

        Raises:
            Timeout: It is not there in time, with the distance that is left to arm and set-point, and what that means.
            Refused: The controllet lost an arm, with the reason: a stop, a reflex, another switch, the safety stage.
            Disconnected: The run has ended.
        """
        deadline, client, name = time.monotonic() + timeout_s, self.controllet.client, self.controllet.name
        while True:
            run = client.state()
            state, arms = run.arms[self.arm], [run.arms[arm] for arm in self.controllet.arms]
            if lost := client.loss(name, self.controllet.arms, run, self.accepted_at_s):
                raise Refused("not_active", lost, "read the state of the arm, then switch again")
            still = all(float(np.max(np.abs(arm.dq_rad_per_s))) <= speed_rad_per_s for arm in arms)
            if still and state.t_s > self.accepted_at_s:
                distance, angle = self.error(state)
                if (distance <= position_m and angle <= angle_rad) or self.ended_by:
                    return state
            if time.monotonic() >= deadline:
                raise self._late(state, timeout_s)
            time.sleep(_PERIOD_S)
