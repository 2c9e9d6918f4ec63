"""Arms of a run as a robot: named numbers out, named targets in. Every target is checked before any arm gets one."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Mapping

import numpy as np

from ..client import Client
from ..controllet import Controllet
from ..errors import Error, Refused
from ..pose import Pose
from ..rotations import Array
from ..state import ArmState, RunState
from ..stream import Stream
from .fingers import WIDEST_M, Fingers
from .names import SteadySigns, action_names, gripper_name, in_world, quantity_names, state_names, state_values
from .runs import Connected, arms_of, close_run, entries, started_here, take_from, with_grippers
from .settings import RobotSettings

_LOGGER = logging.getLogger("multipanda.lerobot")
_UNIT_NORM = 0.02  # tolerated deviation of a policy's quaternion from length 1
_SILENCE = "reference stale"


class ArmsRobot(Connected):
    """One, two or more arms. LeRobot's robot of the package lerobot_robot_multipanda is made of it.

    connect() moves nothing. The first action activates the arms' controllets and opens their streams, if it is near the
    arms; the loop limits and smooths later ones. A refused action holds all arms of the robot, and so do disconnect(),
    silence, and the end of this process.

    Attributes:
        settings: What it was made from.
        silences: How often an arm was held because no action came in time, and begun again by the next one.
    """

    def __init__(self, settings: RobotSettings) -> None:
        """Raises ValueError for invalid settings of a robot."""
        super().__init__()
        settings.check()
        self.settings = settings
        self.silences = 0
        self._bases: dict[str, Array] = {}
        self._laws: dict[str, tuple[Controllet, str]] = {}  # controllet and its input, by arm
        self._taken: set[str] = set()  # arms that we have activated a controllet for
        self._streams: dict[str, Stream] = {}
        self._begun: dict[str, float] = {}  # loop time when an arm's controllet got it
        self._fingers: dict[str, Fingers] = {}
        self._signs = SteadySigns()

    @property
    def state_names(self) -> list[str]:
        """The names of an observation; known without a connection."""
        s = self.settings
        return state_names(s.arms, s.observe, s.grippers, s.joints)

    @property
    def action_names(self) -> list[str]:
        """The names of an action; known without a connection."""
        s = self.settings
        return action_names(s.arms, s.action, s.grippers, s.joints)

    def connect(self) -> None:
        """Starts the scene or attaches to it. Nothing moves.

        Raises:
            Refused: The scene has other arms, or no controllet that follows the actions.
            Timeout: The run does not answer.
            Disconnected: No scene runs.
        """
        s = self.settings
        for name in ("max_jump_rad", "max_jump_m", "max_turn_rad"):
            if getattr(s, name) > getattr(type(s)(), name):
                _LOGGER.warning("%s is loosened to %g", name, getattr(s, name))
        self._open(s, self._look)

    def _look(self, client: Client) -> None:
        """Finds the arms, their controllets and fingers."""
        s = self.settings
        self._bases = arms_of(client, s.arms, s.joints)
        self._laws = {arm: _law_of(client, arm, s.action, s.controllets.get(arm)) for arm in s.arms}
        with_grippers(client, s.grippers)
        state = client.state()
        if "wrench" in s.observe and any(state.arms[arm].wrench_n_nm is None for arm in s.arms):
            raise Refused("no_wrench", "an arm estimates no wrench", "leave it out of `observe`")
        hands = {arm: client.arms[arm].gripper for arm in s.grippers}
        self._fingers = {arm: Fingers(hand, s.grasp_below_m, s.grasp_force_n) for arm, hand in hands.items()}

    def observe(self) -> dict[str, float]:
        """Measurements of the arms, at most 0.1 s old, all of one cycle.

        Raises:
            Timeout: The loop has stalled.
            Disconnected: The run has ended, or the robot is not connected.
        """
        state = self.client.state()
        found: dict[str, float] = {}
        for arm in self.settings.arms:
            for quantity in self.settings.observe:
                values = state_values(state.arms[arm], self._bases[arm], quantity)
                if quantity == "pose":
                    values = self._signs.of(arm, values)
                found.update(zip(quantity_names(arm, quantity, self.settings.joints), values.tolist()))
            if arm in self._fingers:
                gripper = state.arms[arm].gripper
                found[gripper_name(arm)] = float("nan") if gripper is None else gripper.width_m
        return found

    def act(self, action: Mapping[str, float]) -> dict[str, float]:
        """Sends the newest target of every arm; never waits for the motion. Every exception leaves the arms held.

        Args:
            action: A number for each of `action_names` [rad], [m], in the frame of each arm's base.

        Returns:
            What was sent: the same numbers, quaternions with length 1.

        Raises:
            ValueError: Names are missing or unknown, or a number is not finite.
            Refused: A target is too far away; an arm is stopped, in error, or owned by another controllet.
            Timeout: The loop has stalled.
            Disconnected: The run has ended, or the robot is not connected.
        """
        client = self.client
        try:
            targets, widths = self._read(action)
            state = client.state()
            for arm, target in targets.items():
                self._check(target, state.arms[arm])
            self._begin(client, state)
            for arm, target in targets.items():
                pose = self.settings.action == "pose"
                self._streams[arm].send(in_world(self._bases[arm], target) if pose else target)
            for arm, width in widths.items():
                self._fingers[arm].aim(width)
        except BaseException:
            self.hold()
            raise
        sent: dict[str, float] = {}
        for arm, target in targets.items():
            sent.update(zip(quantity_names(arm, self.settings.action, self.settings.joints), target.tolist()))
            if arm in widths:
                sent[gripper_name(arm)] = widths[arm]
        return sent

    def _read(self, action: Mapping[str, float]) -> tuple[dict[str, Array], dict[str, float]]:
        expected = self.action_names
        missing = [name for name in expected if name not in action]
        unknown = [name for name in action if name not in set(expected)]
        if missing or unknown:
            raise ValueError(
                f"action: missing {', '.join(missing) or 'nothing'}; unknown {', '.join(unknown) or 'nothing'}"
            )
        numbers = {name: float(action[name]) for name in expected}
        wrong = [name for name in expected if not np.isfinite(numbers[name])]
        if wrong:
            raise ValueError(f"action: expected finite numbers, found {numbers[wrong[0]]} as {wrong[0]}")
        targets, widths = {}, {}
        for arm in self.settings.arms:
            names = quantity_names(arm, self.settings.action, self.settings.joints)
            target = np.array([numbers[name] for name in names])
            if self.settings.action == "pose":
                norm = float(np.linalg.norm(target[3:]))
                if abs(norm - 1) > _UNIT_NORM:
                    raise ValueError(f"action: expected a quaternion of length 1 for '{arm}', found length {norm:.3f}")
                target[3:] /= norm
            targets[arm] = target
            if arm in self._fingers:
                widths[arm] = numbers[gripper_name(arm)]
                if widths[arm] > WIDEST_M:
                    raise ValueError(
                        f"action: expected at most {WIDEST_M} m for the fingers of '{arm}', found {widths[arm]:g}"
                    )
        return targets, widths

    def _check(self, target: Array, state: ArmState) -> None:
        """Raises Refused if the arm may not move, or not to this target."""
        s = self.settings
        if state.stopped:
            raise Refused("arm_stopped", f"arm '{state.arm}' is stopped")
        if state.errors:
            raise Refused("arm_not_ready", f"arm '{state.arm}' has stopped itself: {state.reason}")
        if s.action == "joints":
            away = np.abs(target - state.q_rad)
            k = int(np.argmax(away))
            if away[k] > s.max_jump_rad:
                raise _jump(
                    f"joint {k + 1} of '{state.arm}' is at {state.q_rad[k]:.3f} rad, its target at {target[k]:.3f} rad",
                    f"{s.max_jump_rad:g} rad",
                )
            return
        hand = Pose.of(state_values(state, self._bases[state.arm], "pose"))
        goal = Pose.of(target)
        distance = float(np.linalg.norm(goal.position_m - hand.position_m))
        if distance > s.max_jump_m:
            raise _jump(f"the target of '{state.arm}' is {distance:.3f} m away from its hand", f"{s.max_jump_m:g} m")
        if hand.angle_to(goal) > s.max_turn_rad:
            raise _jump(
                f"the target of '{state.arm}' is turned by {hand.angle_to(goal):.3f} rad from its hand",
                f"{s.max_turn_rad:g} rad",
            )

    def _begin(self, client: Client, state: RunState) -> None:
        """Activates controllets and opens streams where missing."""
        for arm in [arm for arm in self._streams if state.arms[arm].controllet != self._laws[arm][0].name]:
            lost = state.arms[arm]
            cause = client.lost_by(self._laws[arm][0].name, lost, self._begun[arm])
            if not (lost.held and cause.startswith(_SILENCE)):
                raise Refused(
                    "not_active",
                    f"{self._laws[arm][0].name} lost '{arm}', which {lost.controllet} owns now: {cause}",
                    "check the cause; the next action starts again if the arm is held",
                )
            self.silences += 1
            self._streams.pop(arm).close()
        begun = [arm for arm in self.settings.arms if arm not in self._streams]
        if not begun:
            return
        for arm in begun:
            owned = state.arms[arm]
            if not (owned.held or owned.controllet == self._laws[arm][0].name or started_here(client)):
                raise Refused(
                    "two_owners",
                    f"'{arm}' is owned by {owned.controllet}, which this robot has not activated",
                    "deactivate it first: the arm is held then",
                )
        laws = {self._laws[arm][0].name: arm for arm in begun}
        for channel in client.ask({"do": "channels"})["channels"]:
            if channel["controllet"] in laws:
                raise Refused(
                    "two_owners",
                    f"another client streams to {channel['controllet']} of '{laws[channel['controllet']]}'",
                    "end that stream first",
                )
        self._taken |= set(begun)
        answer = client.switch([self._laws[arm][0].name for arm in begun])
        for arm in begun:
            law, name = self._laws[arm]
            self._begun[arm] = float(answer["t_s"])
            self._streams[arm] = law.stream(name)

    def hold(self) -> None:
        """Holds the arms that this robot moves, all at the same cycle, and their fingers. Never raises. The next action
        begins again."""
        self._hold_arms()
        for fingers in self._fingers.values():
            fingers.stop()

    def _hold_arms(self) -> None:
        taken, self._taken = self._taken, set()
        streams, self._streams = self._streams, {}
        if self._client is None or not taken:
            return
        take_from(self._client, [self._laws[arm][0].name for arm in taken])
        for stream in streams.values():
            with contextlib.suppress(Error, OSError):
                stream.close()

    def disconnect(self) -> None:
        """Holds the arms, and ends a run that connect() has started. May be called again; raises nothing."""
        self._hold_arms()
        client, self._client = self._client, None
        if client is None:
            return
        for fingers in self._fingers.values():
            fingers.stop()
        close_run(client)


def _jump(found: str, most: str) -> Refused:
    return Refused(
        "jump",
        f"{found}; at most {most} are accepted",
        "bring leader and arm together first, or send targets more often",
    )


def _law_of(client: Client, arm: str, action: str, named: str | None) -> tuple[Controllet, str]:
    """The controllet that follows an action, and its input."""
    found: dict[str, list[str]] = {}
    for name, entry in entries(client).items():
        if entry["arms"] == [arm] and (named is None or name == named):
            inputs = [spec["name"] for spec in entry["inputs"] if spec["quantity"] == action]
            if len(inputs) == 1:
                found[name] = inputs
    if len(found) == 1:
        ((name, (spec,)),) = found.items()
        return client.controllets[name], spec
    if named is not None:
        raise Refused("unknown_instance", f"'{named}' does not own '{arm}' alone, or has no single input of {action}")
    if not found:
        raise Refused(
            "unknown_instance",
            f"{client.scene} has no controllet of '{arm}' alone that takes {action}",
            "add one to the scene, such as "
            + ("joint_impedance" if action == "joints" else "cartesian_impedance")
            + ", or choose the other `action`",
        )
    raise Refused(
        "several_controllets",
        f"several controllets of '{arm}' take {action}: {', '.join(found)}",
        f"name one: controllets={{'{arm}': '{next(iter(found))}'}}",
    )
