"""One world."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from multipanda.errors import Refused
from numpy.typing import ArrayLike

from ._core import core
from ._views import Arm, Array, arms_of, objects_of, start_of
from .commands import Commands, Mask

_ALONE = np.ones(1, dtype=np.uint8)


class World(Commands):
    """A simulated world of a scene with its control loop. It is at rest until `step`.

    By default it does the same as `multipanda run`: the same controllets, the same timeline, and with the same seed the
    same noise. Use it from one thread at a time. Commands raise ValueError for unknown names and wrong sizes, and
    Refused for what can be refused at once; the rest is decided in the next cycle: see `step`.

    Attributes:
        arms: Its arms by name; their arrays change with every step.
        objects: Poses of free objects in the world by name: x y z [m], qw qx qy qz.
    """

    def __init__(
        self,
        scene: str | os.PathLike[str],
        seed: int | None = None,
        *,
        hidden: bool = False,
        q_start_rad: Mapping[str, ArrayLike] | None = None,
        objects: Mapping[str, ArrayLike] | None = None,
        active: Sequence[str] | None = None,
    ) -> None:
        """
        Args:
            scene: A scene's name or file.
            seed: As for `reset`, which this calls.
            hidden: As for `reset`.
            q_start_rad: As for `reset` [rad].
            objects: As for `reset`.
            active: As for `reset`.

        Raises:
            ValueError: The scene or the beginning is not accepted.
        """
        self._batch = core.Batch(os.fspath(scene), 1, 1)
        self.arms: dict[str, Arm] = arms_of(self._batch, alone=True)
        self.objects: dict[str, Array] = objects_of(self._batch, alone=True)
        self.reset(seed, hidden=hidden, q_start_rad=q_start_rad, objects=objects, active=active)

    def reset(
        self,
        seed: int | None = None,
        *,
        hidden: bool = False,
        q_start_rad: Mapping[str, ArrayLike] | None = None,
        objects: Mapping[str, ArrayLike] | None = None,
        active: Sequence[str] | None = None,
    ) -> None:
        """Builds the world again and runs its first cycle, so that the arms have measured.

        Nothing of its previous state remains.

        Args:
            seed: Of the noise; None: the scene's.
            hidden: Whether the simulated arms differ from their models by a draw of the seed (docs/simulation.md).
            q_start_rad: Joint angles by arm [rad]; other arms begin as in the scene.
            objects: Poses of free objects by name: x y z [m], qw qx qy qz; others as in the scene.
            active: Controllets that run from the first cycle on. None: as the scene says, with its timeline; otherwise
                the timeline is left out.

        Raises:
            ValueError: A name, a size or a number that is not accepted.
        """
        start = start_of(self._batch.seed if seed is None else seed, hidden, q_start_rad, objects, active)
        self._batch.reset(_ALONE, [start])

    # --- steps ---

    def step(self, cycles: int = 1) -> None:
        """Runs the loop for a number of cycles of 1 ms; Python's lock is released.

        Raises:
            Refused: In its first cycle the loop, an arm or a gripper refused a command. All cycles were run.
        """
        before = self._batch.refusal(0)
        self._batch.step(_ALONE, cycles)
        if self._batch.refusal(0) != before:
            raise Refused("refused", self._batch.refusal(0)[len(before) :].removeprefix("; ").removeprefix("refused: "))

    @property
    def cycles(self) -> int:
        """How many cycles have run since the beginning, the first one included."""
        return int(self._batch.cycles(0))

    @property
    def t_s(self) -> float:
        """Time since the first cycle [s]."""
        return (self.cycles - 1) / 1000

    @property
    def active(self) -> list[str]:
        """The controllets that run now, holds included."""
        return list(self._batch.active(0))

    @property
    def held(self) -> str:
        """Which arms are held, and why; empty if none is."""
        return str(self._batch.held(0))

    # --- commands: from the next cycle on ---

    def _rows(self, values: ArrayLike) -> Array:
        return np.ascontiguousarray(values, dtype=np.float64).reshape(1, -1)

    def _send(self, request: dict[str, Any], rows: dict[str, Array], mask: Mask | None) -> None:
        try:
            self._batch.tell(json.dumps(request), rows)
        except core.RequestRefused as refused:
            raise Refused("refused", str(refused)) from None

    def stop(self, *arms: str) -> None:
        """Holds these arms from the next cycle on, until `resume`; without names all."""
        self._tell("stop", None, arms=arms or "all")

    def resume(self, *arms: str) -> None:
        """Ends a stop; the arms stay in hold until a controllet is activated. Without names all."""
        self._tell("resume", None, arms=arms or "all")

    def recover(self, arm: str) -> None:
        """Clears an arm's error; it stays in hold."""
        self._tell("recover", None, arm=arm)

    def gripper_answer(self, arm: str) -> str:
        """How the arm's newest gripper motion ended: `done`, or why it failed; empty while it moves."""
        return str(self._batch.gripper_answer(0, arm))

    def push(self, name: str, force_n: ArrayLike, duration_s: float = 0.2) -> None:
        """Pushes a free object at its center of mass with a force in world axes [N] for a time [s]."""
        self._tell("push_object", None, {"force_n": force_n, "duration_s": duration_s}, object=name)

    # --- save and restore ---

    def save(self) -> bytes:
        """The world as it is now: its beginning and all commands since, a few kilobytes.

        Any World or Batch of the same scene can restore it, in another process, too.
        """
        return bytes(self._batch.save(0))

    def restore(self, saved: bytes) -> None:
        """Computes a saved world again, bit for bit; this takes as long as its cycles did.

        Raises:
            ValueError: Invalid bytes, another scene, or a computer or program with different results.
        """
        self._batch.restore(0, saved)
