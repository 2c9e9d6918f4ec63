"""From a policy's normalized actions to set-points and parameters of controllets: the same for simulated, virtual and
real arms.

An action is an array of numbers from -1 to 1, N worlds by `mapping.size`. `ActionMapping.command` turns it into the
values that go to the inputs and parameters of controllets. Nothing here depends on Gymnasium or on the simulation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..rotations import Array, compose, conjugate, exponential, inverse, logarithm, multiply, normalized, rotate
from .arms import States

# The loop follows a stream one period late, so an action is added to the nominal pose of the next step.
LEAD_STEPS = 1

Key = tuple[str, str]  # a controllet, and one of its inputs or parameters
Mask = NDArray[np.bool_]


@dataclass
class Command:
    """What is sent for one action.

    Attributes:
        targets: Set-points by (controllet, input): N rows, as `Stream.send` takes them, in the world frame.
        parameters: Values by (controllet, parameter): N rows.
        grippers: By arm, N x 2: the width [m] and the force [N] that its gripper is to have; force 0: it moves there,
            otherwise it grasps. Sent when it changes.
    """

    targets: dict[Key, Array] = field(default_factory=dict)
    parameters: dict[Key, Array] = field(default_factory=dict)
    grippers: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Quantity:
    """One number of an action: its name, and what -1 and 1 mean."""

    name: str
    unit: str
    low: float
    high: float
    frame: str = ""


class Part(ABC):
    """One part of an action."""

    @property
    @abstractmethod
    def quantities(self) -> list[Quantity]:
        """What each of its numbers means."""

    def reset(self, states: States, mask: Mask) -> None:
        """Begins again in the worlds of the mask, from the measured state."""
        return

    @abstractmethod
    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        """Adds what an action, N x numbers, commands."""


def scaled(action: Array, low: Array | float, high: Array | float) -> Array:
    """-1 becomes low, 1 becomes high, linearly."""
    value: Array = low + 0.5 * (action + 1) * (np.asarray(high) - low)
    return value


def scaled_log(action: Array, low: float, high: float) -> Array:
    """-1 becomes low, 1 becomes high, and 0 their geometric mean."""
    value: Array = low * (high / low) ** (0.5 * (action + 1))
    return value


class PosePart(Part):
    """The set-point of a hand, in the axes of the arm's base.

    `around`: the action is added to a nominal pose, which the task gives in the base's frame. Otherwise it moves the
    last set-point; then `leash_m` and `leash_rad` keep the set-point near the measured hand, so that it cannot run
    ahead of a blocked hand.
    """

    def __init__(
        self,
        controllet: str,
        input_name: str,
        arms: Sequence[str],
        base: Array,
        *,
        step_m: float,
        step_rad: float = 0.0,
        around: bool = False,
        low_m: Sequence[float] = (-np.inf,) * 3,
        high_m: Sequence[float] = (np.inf,) * 3,
        leash_m: float = np.inf,
        leash_rad: float = np.inf,
        axes_of_world: bool = False,
    ) -> None:
        """
        Args:
            controllet: Name of the controllet.
            input_name: Name of its input.
            arms: Arms that it moves; of two, the set-point is midway between the hands, with the axes of the world.
            base: X_WB: x y z qw qx qy qz.
            step_m: What an action of 1 moves the set-point along each axis [m].
            step_rad: What it turns it about each axis [rad]; 0: the action has no rotation.
            around: Whether it is added to a nominal pose.
            low_m: Lower corner of the box that the set-point stays in, in the base's frame [m].
            high_m: Its upper corner [m].
            leash_m: Largest distance of the set-point from the hand [m].
            leash_rad: Largest angle between both [rad].
            axes_of_world: Whether the set-point begins with the axes of the world, as that of two arms does.
        """
        self.controllet, self.input_name, self.arms = controllet, input_name, tuple(arms)
        self.base = np.asarray(base, dtype=np.float64)
        self.step_m, self.step_rad, self.around = step_m, step_rad, around
        self.low_m, self.high_m = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
        self.leash_m, self.leash_rad, self.axes_of_world = leash_m, leash_rad, axes_of_world
        self.set_point = np.zeros((0, 7))

    @property
    def quantities(self) -> list[Quantity]:
        what = "offset" if self.around else "step"
        frame = "base" if len(self.arms) == 1 else "world"
        moved = [Quantity(f"{what}_{axis}", "m", -self.step_m, self.step_m, frame) for axis in "xyz"]
        turned = [Quantity(f"turn_{axis}", "rad", -self.step_rad, self.step_rad, frame) for axis in "xyz"]
        return moved + (turned if self.step_rad > 0 else [])

    def measured(self, states: States) -> Array:
        """Where the set-point would be without an error, in the base's frame."""
        hands = [states[arm].pose for arm in self.arms]
        pose = hands[0].copy()
        pose[:, :3] = np.mean([hand[:, :3] for hand in hands], axis=0)
        if self.axes_of_world:
            pose[:, 3:] = [1, 0, 0, 0]
        return compose(inverse(self.base), pose)

    def away(self, states: States) -> tuple[float, float]:
        """The largest distance [m] and angle [rad] of the newest set-points from the hands."""
        measured = self.measured(states)
        turn = logarithm(multiply(self.set_point[:, 3:], conjugate(measured[:, 3:])))
        far = np.linalg.norm(self.set_point[:, :3] - measured[:, :3], axis=1)
        return float(far.max()), float(np.linalg.norm(turn, axis=1).max())

    def reset(self, states: States, mask: Mask) -> None:
        measured = self.measured(states)
        if len(self.set_point) != len(measured):
            self.set_point = measured.copy()
        self.set_point[mask] = measured[mask]

    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        begin = self.set_point
        if self.around:
            if around is None:
                raise ValueError("expected the nominal pose of the task: this part of the action is added to it")
            begin = around
        position = np.clip(begin[:, :3] + self.step_m * action[:, :3], self.low_m, self.high_m)
        quaternion = begin[:, 3:]
        if self.step_rad > 0:
            quaternion = normalized(multiply(exponential(self.step_rad * action[:, 3:6]), quaternion))
        measured = self.measured(states)
        if np.isfinite(self.leash_m):
            away = position - measured[:, :3]
            far = np.linalg.norm(away, axis=1, keepdims=True)
            position = measured[:, :3] + away * np.minimum(1, self.leash_m / np.maximum(far, 1e-12))
        if np.isfinite(self.leash_rad):
            turn = logarithm(multiply(quaternion, conjugate(measured[:, 3:])))
            far = np.linalg.norm(turn, axis=1, keepdims=True)
            turn = turn * np.minimum(1, self.leash_rad / np.maximum(far, 1e-12))
            held = normalized(multiply(exponential(turn), measured[:, 3:]))
            quaternion = np.where(far > self.leash_rad, held, quaternion)
        self.set_point = np.concatenate([position, quaternion], axis=1)
        command.targets[self.controllet, self.input_name] = compose(self.base, self.set_point)


class JointsPart(Part):
    """The joint set-points of one arm, moved by the action and kept near the measured joints."""

    def __init__(
        self,
        controllet: str,
        arm: str,
        *,
        step_rad: float,
        low_rad: Sequence[float],
        high_rad: Sequence[float],
        leash_rad: float,
    ) -> None:
        """
        Args:
            controllet: Name of a controllet with the input `joints`.
            arm: Its arm.
            step_rad: What an action of 1 moves each joint's set-point [rad].
            low_rad: Lower limits of the set-points [rad].
            high_rad: Upper limits [rad].
            leash_rad: Largest distance of each set-point from the joint [rad].
        """
        self.controllet, self.arm, self.step_rad, self.leash_rad = controllet, arm, step_rad, leash_rad
        self.low_rad, self.high_rad = np.asarray(low_rad, dtype=np.float64), np.asarray(high_rad, dtype=np.float64)
        self.set_point = np.zeros((0, len(self.low_rad)))

    @property
    def quantities(self) -> list[Quantity]:
        joints = range(1, len(self.low_rad) + 1)
        return [Quantity(f"{self.arm}_joint{k}", "rad", -self.step_rad, self.step_rad) for k in joints]

    def reset(self, states: States, mask: Mask) -> None:
        measured = states[self.arm].q_rad
        if len(self.set_point) != len(measured):
            self.set_point = measured.copy()
        self.set_point[mask] = measured[mask]

    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        measured = states[self.arm].q_rad
        moved = np.clip(self.set_point + self.step_rad * action, measured - self.leash_rad, measured + self.leash_rad)
        self.set_point = np.clip(moved, self.low_rad, self.high_rad)
        command.targets[self.controllet, "joints"] = self.set_point.copy()


class WrenchPart(Part):
    """The desired force of a law that presses, in the axes of the arm's base; the desired moment is zero."""

    def __init__(self, controllet: str, base: Array, *, low_n: Sequence[float], high_n: Sequence[float]) -> None:
        """
        Args:
            controllet: Name of a controllet with the input `wrench`.
            base: X_WB: x y z qw qx qy qz.
            low_n: What -1 means along each axis [N]: the force that the arm exerts.
            high_n: What 1 means [N].
        """
        self.controllet, self.base = controllet, np.asarray(base, dtype=np.float64)
        self.low_n, self.high_n = np.asarray(low_n, dtype=np.float64), np.asarray(high_n, dtype=np.float64)

    @property
    def quantities(self) -> list[Quantity]:
        return [Quantity(f"force_{a}", "N", lo, hi, "base") for a, lo, hi in zip("xyz", self.low_n, self.high_n)]

    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        force = rotate(self.base[3:], scaled(action, self.low_n, self.high_n))
        command.targets[self.controllet, "wrench"] = np.concatenate([force, np.zeros_like(force)], axis=1)


class ScalarPart(Part):
    """An input that carries one number, such as a squeeze [N]."""

    def __init__(self, controllet: str, input_name: str, unit: str, low: float, high: float) -> None:
        """
        Args:
            controllet: Name of the controllet.
            input_name: Name of its input.
            unit: Unit of the number.
            low: What -1 means.
            high: What 1 means.
        """
        self.controllet, self.input_name, self.unit, self.low, self.high = controllet, input_name, unit, low, high

    @property
    def quantities(self) -> list[Quantity]:
        return [Quantity(self.input_name, self.unit, self.low, self.high)]

    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        command.targets[self.controllet, self.input_name] = scaled(action, self.low, self.high)


class ParameterPart(Part):
    """A parameter of a controllet, such as its stiffness; the loop approaches each value within 0.2 s."""

    def __init__(
        self, controllet: str, parameter: str, unit: str, low: float, high: float, *, count: int = 1, log: bool = True
    ) -> None:
        """
        Args:
            controllet: Name of the controllet.
            parameter: Name of the parameter.
            unit: Its unit.
            low: What -1 means.
            high: What 1 means.
            count: How many numbers the parameter has.
            log: Whether the scale is logarithmic, as suits a stiffness.
        """
        self.controllet, self.parameter, self.unit, self.low, self.high = controllet, parameter, unit, low, high
        self.count, self.log = count, log

    @property
    def quantities(self) -> list[Quantity]:
        names = [self.parameter] if self.count == 1 else [f"{self.parameter}_{axis}" for axis in "xyz"[: self.count]]
        return [Quantity(name, self.unit, self.low, self.high) for name in names]

    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        value = scaled_log(action, self.low, self.high) if self.log else scaled(action, self.low, self.high)
        command.parameters[self.controllet, self.parameter] = value


class GripperPart(Part):
    """Opens and closes a gripper: above 0.2 it grasps, below -0.2 it opens, in between it keeps its state."""

    def __init__(self, arm: str, *, width_m: float, force_n: float, open_m: float = 0.078) -> None:
        """
        Args:
            arm: Its arm.
            width_m: Width of what it grasps [m].
            force_n: Force of a grasp [N].
            open_m: Distance of open fingers [m].
        """
        self.arm, self.width_m, self.force_n, self.open_m = arm, width_m, force_n, open_m
        self.closed = np.zeros(0, dtype=np.bool_)

    @property
    def quantities(self) -> list[Quantity]:
        return [Quantity(f"{self.arm}_grasp", "", -1, 1)]

    def reset(self, states: States, mask: Mask) -> None:
        count = len(states[self.arm].pose)
        if len(self.closed) != count:
            self.closed = np.zeros(count, dtype=np.bool_)
        gripper = states[self.arm].gripper
        # An object that is held at the start stays held until the policy opens the hand.
        self.closed[mask] = False if gripper is None else gripper[mask, 1] > 0.5

    def add(self, command: Command, action: Array, states: States, around: Array | None) -> None:
        self.closed = np.where(action[:, 0] > 0.2, True, np.where(action[:, 0] < -0.2, False, self.closed))
        width = np.where(self.closed, self.width_m, self.open_m)
        command.grippers[self.arm] = np.column_stack([width, np.where(self.closed, self.force_n, 0.0)])


class ActionMapping:
    """A list of parts, in the order of the action's numbers, at a fixed rate.

    Attributes:
        controllets: Controllets that must be active.
        parts: The parts.
        rate_hz: Actions per second.
        size: How many numbers an action has.
    """

    def __init__(self, controllets: Sequence[str], parts: Sequence[Part], rate_hz: float = 20) -> None:
        self.controllets, self.parts, self.rate_hz = tuple(controllets), tuple(parts), rate_hz
        self._counts = [len(part.quantities) for part in parts]
        self.size = sum(self._counts)

    @property
    def cycles(self) -> int:
        """Cycles of 1 ms from one action to the next."""
        return round(1000 / self.rate_hz)

    @property
    def quantities(self) -> list[Quantity]:
        """What each number of an action means."""
        return [quantity for part in self.parts for quantity in part.quantities]

    def reset(self, states: States, mask: Mask | None = None) -> None:
        """Begins an episode, in all worlds or in those of the mask, from the measured state."""
        count = len(next(iter(states.values())).pose)
        chosen = np.ones(count, dtype=np.bool_) if mask is None else mask
        for part in self.parts:
            part.reset(states, chosen)

    def away(self, states: States) -> tuple[float, float]:
        """The largest distance [m] and angle [rad] of the newest set-points of hands from the measured ones."""
        found = [part.away(states) for part in self.parts if isinstance(part, PosePart)]
        return max((far for far, _ in found), default=0.0), max((turn for _, turn in found), default=0.0)

    def command(self, action: Array, states: States, around: Array | None = None) -> Command:
        """What an action commands.

        Args:
            action: N x size; numbers beyond -1 and 1 are clipped.
            states: The measured states.
            around: The task's nominal pose in the base's frame, N x 7, for parts that are added to it.

        Raises:
            ValueError: Another size, or a number that is not finite.
        """
        numbers = np.asarray(action, dtype=np.float64)
        if numbers.ndim != 2 or numbers.shape[1] != self.size:
            raise ValueError(f"expected actions of {self.size} numbers, found an array of {numbers.shape}")
        if not np.all(np.isfinite(numbers)):
            raise ValueError("expected finite numbers in an action")
        numbers = np.clip(numbers, -1, 1)
        command, begin = Command(), 0
        for part, count in zip(self.parts, self._counts):
            part.add(command, numbers[:, begin : begin + count], states, around)
            begin += count
        return command
