"""Fingers follow the widths of actions."""

from __future__ import annotations

import contextlib
import logging
import time

from ..arm import Gripper
from ..errors import Error

_LOGGER = logging.getLogger("multipanda.lerobot")
WIDEST_M = 0.2  # wider than any hand opens
_PERIOD_S, _SILENCE_S = 0.02, 0.5


class Fingers:
    """The hand of one arm."""

    def __init__(self, gripper: Gripper, grasp_below_m: float, force_n: float) -> None:
        """
        Args:
            gripper: The hand.
            grasp_below_m: A width at or below it is fully closed [m].
            force_n: Force on what is between the fingers [N].
        """
        self._gripper, self._grasp_below_m, self._force_n = gripper, grasp_below_m, force_n
        self._sent_s, self._said, self._follows = 0.0, "", False

    def aim(self, width_m: float) -> None:
        """Lets the fingers follow a width [m]. Does not wait."""
        now = time.monotonic()
        if now - self._sent_s < _PERIOD_S:
            return
        self._sent_s, self._follows = now, True
        width_m = 0.0 if width_m <= self._grasp_below_m else width_m
        try:
            self._gripper.follow(width_m, force_n=self._force_n, silence_s=_SILENCE_S)
        except Error as wrong:
            if str(wrong) != self._said:
                _LOGGER.warning("fingers: %s", wrong)
            self._said = str(wrong)

    def stop(self) -> None:
        """The fingers stay where they are, and hold what they hold. Never raises."""
        follows, self._follows = self._follows, False
        if follows:
            with contextlib.suppress(Error, OSError):
                self._gripper.hold()
