"""The worlds of a task: simulated arms with their control loop, stepped together on threads."""

from __future__ import annotations

import ctypes
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Error, ProgramMissing
from ..program import program_path
from ..tasks.actions import Command
from ..tasks.arms import ArmStates
from ..tasks.rotations import Array
from ..tasks.task import Start, Task, Truth

Mask = NDArray[np.bool_]
_ARM, _OBJECT = 35, 7  # numbers of an arm and of an object


def _library() -> ctypes.CDLL:
    folder = pathlib.Path(program_path()).resolve().parent
    for place in (folder, folder.parent / "lib"):
        file = place / "libmultipanda_gym_worlds.so"
        if file.exists():
            library = ctypes.CDLL(os.fspath(file))
            library.mpg_open.restype = ctypes.c_void_p
            return library
    raise ProgramMissing(f"libmultipanda_gym_worlds.so is not beside {folder}", "build it, or install the wheel again")


def _pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


class Worlds:
    """N worlds of a task's scene.

    Attributes:
        task: The task.
        count: How many worlds.
    """

    def __init__(
        self, task: Task, count: int, controllets: Sequence[str], *, plants: bool = False, threads: int = 0
    ) -> None:
        """
        Args:
            task: The task.
            count: How many worlds.
            controllets: Controllets that run from the start.
            plants: Whether each reset draws other arms.
            threads: How many threads; 0: one per processor.

        Raises:
            Error: The scene is not accepted.
        """
        self.task, self.count, self._plants = task, count, plants
        self._names = [arm.name for arm in task.arms]
        self._text = ctypes.create_string_buffer(1000)
        self._library = _library()
        self._handle = self._library.mpg_open(
            os.fspath(task.scene).encode(),
            count,
            " ".join(task.objects).encode(),
            " ".join(controllets).encode(),
            threads,
            self._text,
            ctypes.c_size_t(1000),
        )
        if not self._handle:
            raise Error(self._text.value.decode(), "see the scene")
        self._arms = np.zeros((count, len(self._names), _ARM))
        self._objects = np.zeros((count, len(task.objects), _OBJECT))
        self._stopped = np.zeros(count, dtype=np.uint8)

    def _call(self, name: str, *arguments: Any) -> None:
        if not self._handle:
            raise Error("these worlds are closed", "make the environment again")
        failed = getattr(self._library, name)(
            ctypes.c_void_p(self._handle), *arguments, self._text, ctypes.c_size_t(1000)
        )
        if failed:
            raise Error(self._text.value.decode(), "see the scene")

    def reset(self, mask: Mask, seeds: NDArray[np.uint64], starts: Mapping[int, Start]) -> None:
        """Begins again in the worlds of the mask, each as a fresh world of its seed."""
        q = np.zeros((self.count, len(self._names), 7))
        objects = np.zeros_like(self._objects)
        for k, start in starts.items():
            for i, name in enumerate(self._names):
                q[k, i] = start.q_rad[name]
            for i, name in enumerate(self.task.objects):
                objects[k, i] = start.objects[name]
        chosen = mask.astype(np.uint8)
        self._call("mpg_reset", _pointer(chosen), _pointer(seeds), int(self._plants), _pointer(q), _pointer(objects))
        self._step(0, chosen)

    def send(self, command: Command, mask: Mask) -> Mask:
        """Sends set-points and parameters; the loops take them in the next cycle.

        Returns:
            The worlds whose command was refused at once.
        """
        chosen = mask.astype(np.uint8)
        for kind, values in ((0, command.targets), (1, command.parameters)):
            for (controllet, name), numbers in values.items():
                rows = np.ascontiguousarray(numbers, dtype=np.float64)
                self._call(
                    "mpg_target",
                    _pointer(chosen),
                    controllet.encode(),
                    name.encode(),
                    kind,
                    _pointer(rows),
                    rows.shape[1],
                )
        for arm, numbers in command.grippers.items():
            rows = np.ascontiguousarray(numbers, dtype=np.float64)
            self._library.mpg_gripper(
                ctypes.c_void_p(self._handle), _pointer(chosen), self._names.index(arm), _pointer(rows)
            )
        return np.zeros(self.count, dtype=np.bool_)

    def step(self, cycles: int, mask: Mask) -> None:
        """Runs the loops of the mask's worlds for a number of cycles, on threads; Python's lock is released."""
        self._step(cycles, mask.astype(np.uint8))

    def _step(self, cycles: int, chosen: NDArray[np.uint8]) -> None:
        self._call(
            "mpg_step",
            _pointer(chosen),
            cycles,
            _pointer(self._arms),
            _pointer(self._objects),
            _pointer(self._stopped),
        )

    def states(self) -> dict[str, ArmStates]:
        """What the arms measure."""
        states = {}
        for i, name in enumerate(self._names):
            rows = self._arms[:, i]
            gripper = rows[:, 33:35] if name in self.task.grippers else None
            states[name] = ArmStates(rows[:, :7], rows[:, 7:14], rows[:, 14:21], rows[:, 21:27], gripper)
        return states

    def truth(self) -> Truth:
        """What only the simulation knows."""
        wrenches: dict[str, Array] = {name: self._arms[:, i, 27:33] for i, name in enumerate(self._names)}
        return Truth(wrenches, {name: self._objects[:, i] for i, name in enumerate(self.task.objects)})

    def stopped(self) -> Mask:
        """The worlds in which an arm is held, or a command was refused."""
        return self._stopped.astype(np.bool_)

    def reason(self, world: int) -> str:
        """Why the arms of a world have stopped."""
        self._library.mpg_reason(ctypes.c_void_p(self._handle), world, self._text, ctypes.c_size_t(1000))
        return self._text.value.decode()

    def user_stop(self, world: int, arm: int = 0) -> None:
        """Presses the stop button of an arm in one world."""
        self._library.mpg_user_stop(ctypes.c_void_p(self._handle), world, arm)

    def close(self) -> None:
        """Releases the worlds."""
        if self._handle:
            self._library.mpg_close(ctypes.c_void_p(self._handle))
            self._handle = None

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self.close()
