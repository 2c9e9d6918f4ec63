"""Fingers follow widths: a request only when the width has changed, on a thread, since answers come at rest."""

from __future__ import annotations

import contextlib
import logging
import threading

from ..arm import Gripper
from ..errors import Error
from ..state import GripperState

_LOGGER = logging.getLogger("multipanda.lerobot")
WIDEST_M = 0.2  # wider than any hand opens
_ANY_WIDTH_M = 1.0  # a policy's grasp does not know the object's width
_JOIN_S = 2.0


class Fingers:
    """The hand of one arm."""

    def __init__(self, gripper: Gripper, grasp_below_m: float, force_n: float, step_m: float) -> None:
        """
        Args:
            gripper: The hand.
            grasp_below_m: A width at or below it is a grasp [m].
            force_n: Force of a grasp [N].
            step_m: Smallest change that is sent [m].
        """
        self._gripper, self._grasp_below_m, self._force_n, self._step_m = gripper, grasp_below_m, force_n, step_m
        self._sent: float | None = None
        self._closed = False
        self._threads: list[threading.Thread] = []

    def aim(self, width_m: float, state: GripperState | None) -> None:
        """Moves the fingers to a width [m], or grasps; a new motion ends the previous one. Does not wait."""
        if self._sent is None and state is not None and not state.grasped:
            self._sent = state.width_m  # the fingers are already at this width
        grasp = width_m <= self._grasp_below_m
        aim = 0.0 if grasp else width_m
        if self._sent is not None and (aim == self._sent or abs(aim - self._sent) < self._step_m):
            return
        self._sent = aim
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        self._threads.append(threading.Thread(target=self._move, args=(aim, grasp), daemon=True))
        self._threads[-1].start()

    def _move(self, width_m: float, grasp: bool) -> None:
        try:
            if grasp:
                self._gripper.grasp(0, force_n=self._force_n, tolerance_m=_ANY_WIDTH_M)
            else:
                self._gripper.move(width_m)
        except Error as wrong:
            if width_m == self._sent and not self._closed:  # otherwise the next motion has ended it, or the run is over
                _LOGGER.warning("fingers: %s", wrong)

    def stop(self) -> None:
        """Ends a motion that is under way, so that no hand closes on a person once the arms are held.

        A held object stays held. Never raises.
        """
        if any(thread.is_alive() for thread in self._threads):
            with contextlib.suppress(Error, OSError):
                self._gripper.stop()
            self._sent = None  # sends the next width even if it is the same

    def close(self) -> None:
        """Waits briefly for answers. A held object stays held."""
        self._closed = True
        for thread in self._threads:
            thread.join(_JOIN_S)
