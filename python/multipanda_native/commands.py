"""The commands of one world and of many: the same words, from the next cycle on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._views import Array

Mask = NDArray[np.bool_]


class Commands(ABC):
    """Commands to a World or a Batch. `mask` chooses worlds of a Batch, None all; its values have a row per world.

    Unknown names and wrong sizes raise ValueError. What a world refuses raises Refused in a World only.
    """

    @abstractmethod
    def _rows(self, values: ArrayLike) -> Array:
        """The values, a row per world."""

    @abstractmethod
    def _send(self, request: dict[str, Any], rows: dict[str, Array], mask: Mask | None) -> None:
        """Sends the worlds a request, whose numbers differ from world to world."""

    def _tell(
        self, request: str, mask: Mask | None, numbers: Mapping[str, ArrayLike] | None = None, **fields: Any
    ) -> None:
        rows = {key: self._rows(of) for key, of in (numbers or {}).items()}
        self._send({"do": request, **fields}, rows, mask)

    def target(self, controllet: str, input_name: str, values: ArrayLike, mask: Mask | None = None) -> None:
        """A sample of a stream of set-points, as `multipanda.Stream` sends them: smoothed and bounded on the way.

        Args:
            controllet: The controllet's name; it must be active.
            input_name: One of its inputs.
            values: What the input takes, in SI units and world axes (docs/live_input.md).
            mask: Worlds of a Batch.

        Raises:
            ValueError: An unknown name, or a wrong size.
            Refused: The controllet is not active, or a value is not finite or out of reach.
        """
        self._tell("reference", mask, {"values": values}, controllet=controllet, input=input_name, stream=True)

    def goal(
        self, controllet: str, input_name: str, values: ArrayLike, duration_s: float = 0, mask: Mask | None = None
    ) -> None:
        """A set-point that is approached smoothly and stays.

        Args:
            controllet: The controllet's name; it must be active.
            input_name: One of its inputs.
            values: As for `target`.
            duration_s: Time to reach it; longer if limits of speed require it [s].
            mask: Worlds of a Batch.

        Raises:
            ValueError: An unknown name, or a wrong size.
            Refused: As for `target`.
        """
        fields = {"controllet": controllet, "input": input_name, "duration_s": float(duration_s)}
        self._tell("reference", mask, {"values": values}, **fields)

    def parameter(self, controllet: str, name: str, values: ArrayLike | str, mask: Mask | None = None) -> None:
        """A parameter's new value, in the unit that its name or description has; it is reached within 0.2 s.

        Args:
            controllet: The controllet's name.
            name: The parameter; of a feature `feature.name`.
            values: Its numbers, one for all of them, or the name of a choice.
            mask: Worlds of a Batch.

        Raises:
            ValueError: An unknown name, or a wrong size.
            Refused: Out of its bounds.
        """
        if isinstance(values, str):
            self._tell("parameter", mask, controllet=controllet, name=name, value=values)
        else:
            self._tell("parameter", mask, {"value": values}, controllet=controllet, name=name)

    def switch(
        self,
        activate: Sequence[str] = (),
        deactivate: Sequence[str] = (),
        *,
        only: bool = False,
        mask: Mask | None = None,
    ) -> None:
        """Switches controllets between two cycles: all of it, or nothing.

        Args:
            activate: Controllets to start; other owners of their arms stop.
            deactivate: Controllets to stop; arms without an owner are held.
            only: Whether all others stop, too.
            mask: Worlds of a Batch.

        Raises:
            ValueError: An unknown name.
            Refused: Two of them own one arm, or an arm is stopped.
        """
        self._tell("switch", mask, activate=list(activate), deactivate=list(deactivate), only=only)

    def feature(self, controllet: str, feature: str, on: bool, mask: Mask | None = None) -> None:
        """Turns a feature of a controllet on or off.

        Raises:
            ValueError: An unknown name.
            Refused: The feature cannot start.
        """
        self._tell("feature", mask, controllet=controllet, name=feature, on=bool(on))

    def user_stop(self, arm: str, pressed: bool = True, mask: Mask | None = None) -> None:
        """Presses or releases the stop button of an arm."""
        self._tell("user_stop", mask, arm=arm, pressed=bool(pressed))

    def gripper_move(self, arm: str, width_m: ArrayLike, speed_m_per_s: float = 0.1, mask: Mask | None = None) -> None:
        """Moves the fingers to a width [m]. `World.gripper_answer` returns the result."""
        numbers = {"width_m": np.reshape(width_m, (-1, 1))}
        self._tell("gripper", mask, numbers, arm=arm, action="move", speed_m_per_s=float(speed_m_per_s))

    def gripper_grasp(
        self,
        arm: str,
        width_m: ArrayLike,
        force_n: ArrayLike,
        speed_m_per_s: float = 0.1,
        tolerance_m: float = 0.005,
        mask: Mask | None = None,
    ) -> None:
        """Grasps something of about this width [m] with a force [N]."""
        numbers = {"width_m": np.reshape(width_m, (-1, 1)), "force_n": np.reshape(force_n, (-1, 1))}
        limits = {"speed_m_per_s": float(speed_m_per_s), "tolerance_m": float(tolerance_m)}
        self._tell("gripper", mask, numbers, arm=arm, action="grasp", **limits)

    def place(self, name: str, poses: ArrayLike, mask: Mask | None = None) -> None:
        """Puts a free object somewhere, at rest: x y z [m], qw qx qy qz. Refused in the next step where it would
        penetrate another."""
        rows = self._rows(poses)
        self._tell("place_object", mask, {"position_m": rows[:, :3], "quaternion_wxyz": rows[:, 3:]}, object=name)
