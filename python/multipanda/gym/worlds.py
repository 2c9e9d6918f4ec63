"""The worlds of a task: a batch of the native module, with the names and shapes that tasks and mappings use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from multipanda_native import Batch
from numpy.typing import NDArray

from ..rotations import Array
from ..tasks.actions import Command
from ..tasks.arms import ArmStates
from ..tasks.task import Start, Task, Truth

Mask = NDArray[np.bool_]


class Worlds:
    """N worlds of a task's scene.

    Attributes:
        task: The task.
        count: How many worlds.
        batch: The worlds themselves.
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
            ValueError: The scene is not accepted.
        """
        self.task, self.count, self._plants = task, count, plants
        self._controllets = list(controllets)
        self.batch = Batch(task.scene, count, threads=threads)
        self._fingers: dict[str, Array] = {}  # last command to each gripper, NaN: none

    def reset(self, mask: Mask, seeds: NDArray[np.uint64], starts: Mapping[int, Start]) -> None:
        """Begins again in the worlds of the mask, each as a fresh world of its seed."""
        joints = {arm.name: np.zeros((self.count, self.batch.arms[arm.name].joints)) for arm in self.task.arms}
        objects = {name: np.zeros((self.count, 7)) for name in self.task.objects}
        for k, start in starts.items():
            for name, rows in (*joints.items(), *objects.items()):
                rows[k] = start.q_rad[name] if name in joints else start.objects[name]
        self.batch.reset(
            seeds, mask, hidden=self._plants, q_start_rad=joints, objects=objects, active=self._controllets
        )
        for told in self._fingers.values():
            told[mask] = np.nan

    def send(self, command: Command, mask: Mask) -> None:
        """Sends set-points and parameters; the loops take them in the next cycle. `stopped` shows refusals."""
        for (controllet, name), numbers in command.targets.items():
            self.batch.target(controllet, name, numbers, mask)
        for (controllet, name), numbers in command.parameters.items():
            self.batch.parameter(controllet, name, numbers, mask)
        for arm, numbers in command.grippers.items():
            told = self._fingers.setdefault(arm, np.full((self.count, 2), np.nan))
            news = mask & (told != numbers).any(axis=1)
            told[news] = numbers[news]
            grasps = news & (numbers[:, 1] > 0)
            if grasps.any():
                self.batch.gripper_grasp(arm, numbers[:, 0], numbers[:, 1], mask=grasps)
            if (news & ~grasps).any():
                self.batch.gripper_move(arm, numbers[:, 0], mask=news & ~grasps)

    def step(self, cycles: int, mask: Mask) -> None:
        """Runs the loops of the mask's worlds for a number of cycles, on threads; Python's lock is released."""
        self.batch.step(cycles, mask)

    def states(self) -> dict[str, ArmStates]:
        """Measurements of the arms."""
        states = {}
        for arm in self.task.arms:
            seen = self.batch.arms[arm.name]
            gripper = seen.gripper[:, :2] if arm.name in self.task.grippers else None
            states[arm.name] = ArmStates(seen.q_rad, seen.dq_rad_per_s, seen.X_WE, seen.F_K_W_est, gripper)
        return states

    def truth(self) -> Truth:
        """Values known to the simulation only."""
        wrenches = {arm.name: self.batch.arms[arm.name].F_K_W_true for arm in self.task.arms}
        return Truth(wrenches, {name: self.batch.objects[name] for name in self.task.objects})

    def stopped(self) -> Mask:
        """The worlds in which an arm is held, or a command was refused."""
        return self.batch.stopped()

    def reason(self, world: int) -> str:
        """Why the arms of a world have stopped."""
        return "; ".join(why for why in (self.batch.refusal(world), self.batch.held(world)) if why)

    def user_stop(self, world: int, arm: int = 0) -> None:
        """Presses the stop button of an arm in one world."""
        self.batch.user_stop(self.task.arms[arm].name, mask=np.arange(self.count) == world)
