"""Many worlds of one scene."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import core
from ._views import Arm, Array, arms_of, objects_of, start_of
from .commands import Commands, Mask


class Batch(Commands):
    """Worlds of one scene, stepped together on threads while Python's lock is released.

    World k with a seed equals, bit for bit, the `World` of that seed, with any number of threads. Every method takes
    the `mask` of the worlds that it acts on, None for all; the others do not change. A refusal of a world raises
    nothing: `refusal(k)` returns it, and `stopped()` includes that world. Unknown names and wrong sizes raise
    ValueError.

    Attributes:
        arms: The arms by name: arrays with a row per world, which change with every step.
        objects: Poses of free objects by name, a row per world: x y z [m], qw qx qy qz.
    """

    def __init__(self, scene: str | os.PathLike[str], count: int, *, threads: int = 0) -> None:
        """
        Args:
            scene: A scene's name or file.
            count: How many worlds.
            threads: How many threads; 0: one per processor.

        Raises:
            ValueError: The scene is not accepted, or there is no world.
        """
        if count < 1:
            raise ValueError(f"expected at least one world, found {count}")
        self._batch = core.Batch(os.fspath(scene), count, max(0, threads))
        self._all = np.ones(count, dtype=np.uint8)
        self.arms: dict[str, Arm] = arms_of(self._batch, alone=False)
        self.objects: dict[str, Array] = objects_of(self._batch, alone=False)

    def __len__(self) -> int:
        return int(self._batch.count)

    @property
    def threads(self) -> int:
        """How many threads step the worlds."""
        return int(self._batch.threads)

    def _chosen(self, mask: Mask | None) -> NDArray[np.uint8]:
        return self._all if mask is None else np.ascontiguousarray(mask, dtype=np.uint8)

    def reset(
        self,
        seeds: Sequence[int] | NDArray[Any],
        mask: Mask | None = None,
        *,
        hidden: bool = False,
        q_start_rad: Mapping[str, ArrayLike] | None = None,
        objects: Mapping[str, ArrayLike] | None = None,
        active: Sequence[str] | None = None,
    ) -> None:
        """Builds worlds again and runs their first cycle, on threads.

        Args:
            seeds: A seed per world; those outside of the mask are not used.
            mask: The worlds.
            hidden: As for `World.reset`.
            q_start_rad: By arm, a row per world [rad].
            objects: By free object, a row per world: x y z [m], qw qx qy qz.
            active: As for `World.reset`.

        Raises:
            ValueError: A name, a size or a number that is not accepted.
        """
        if len(seeds) != len(self):
            raise ValueError(f"expected {len(self)} seeds, found {len(seeds)}")
        chosen = self._chosen(mask)
        joints = {name: self._rows(q) for name, q in (q_start_rad or {}).items()}
        poses = {name: self._rows(x) for name, x in (objects or {}).items()}
        starts: list[Any] = [None] * len(self)
        for k in map(int, np.flatnonzero(chosen)):
            starts[k] = start_of(
                int(seeds[k]),
                hidden,
                {name: q[k] for name, q in joints.items()},
                {name: x[k] for name, x in poses.items()},
                active,
            )
        self._batch.reset(chosen, starts)

    def _rows(self, values: ArrayLike) -> Array:
        rows = np.ascontiguousarray(values, dtype=np.float64)
        if rows.ndim != 2 or len(rows) != len(self):
            raise ValueError(f"expected {len(self)} rows, found an array of shape {rows.shape}")
        return rows

    def _send(self, request: dict[str, Any], rows: dict[str, Array], mask: Mask | None) -> None:
        self._batch.command(self._chosen(mask), json.dumps(request), rows)

    def step(self, cycles: int, mask: Mask | None = None) -> None:
        """Runs loops for a number of cycles of 1 ms."""
        self._batch.step(self._chosen(mask), cycles)

    # --- results ---

    def stopped(self) -> Mask:
        """The worlds in which an arm is held, or something was refused since the beginning."""
        held: Mask = np.any([arm.held[:, 0] for arm in self.arms.values()], axis=0)
        refused: Mask = np.array([bool(self._batch.refusal(k)) for k in range(len(self))])
        return np.logical_or(held, refused)

    def refusal(self, world: int) -> str:
        """The refusals in a world since its beginning, the first one first; empty if none."""
        return str(self._batch.refusal(world))

    def held(self, world: int) -> str:
        """Which arms of a world are held, and why; empty if none is."""
        return str(self._batch.held(world))

    def cycles(self, world: int) -> int:
        """How many cycles of a world have run since its beginning, the first one included."""
        return int(self._batch.cycles(world))

    def save(self, world: int) -> bytes:
        """A world as it is now; see `World.save`."""
        return bytes(self._batch.save(world))

    def restore(self, world: int, saved: bytes) -> None:
        """Computes a saved world again in place of another; see `World.restore`."""
        self._batch.restore(world, saved)
