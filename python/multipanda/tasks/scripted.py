"""Scripted policies: a baseline, and a proof that each task can be solved from what a real arm reports.

Each takes observations, N x n, and returns actions, N x size. They keep no memory.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..rotations import Array
from .handover import GRASP_M, Handover
from .insert import Insert
from .lift_box import LiftBox
from .press_circle import PressCircle
from .reach import Reach
from .task import Task

BatchPolicy = Callable[[Array], Array]


class Observed:
    """Observations by name."""

    def __init__(self, task: Task, observation: Array) -> None:
        self._places = {name: k for k, name in enumerate(task.observation_names)}
        self._values = observation
        self.seconds = observation[:, self._places["time of the episode, 0 to 1"]] * task.seconds

    def __getitem__(self, name: str) -> Array:
        column: Array = self._values[:, self._places[name]]
        return column

    def vector(self, name: str, unit: str = "m") -> Array:
        """name_x, name_y and name_z, N x 3."""
        return np.stack([self[f"{name}_{axis} [{unit}]"] for axis in "xyz"], axis=1)


def reach(observation: Array) -> Array:
    """Reach by poses: steps towards the point, the smaller the nearer."""
    seen = Observed(Reach(), observation)
    away = seen.vector("point") - seen.vector("arm")
    return np.clip(np.column_stack([10 * away, np.zeros_like(away)]), -1, 1)


def press(observation: Array) -> Array:
    """PressCircle by wrenches: the nominal path, and the desired force; the law controls it."""
    seen = Observed(PressCircle(), observation)
    desired = seen["desired force [10 N], 0 for hovering"] * 10
    action = np.zeros((len(observation), 6))
    action[:, 2] = np.where(desired > 0, -0.12, 0)  # 12 mm deep: the pose reaches the surface wherever it is
    action[:, 5] = 1 - desired / 10
    return action


def insert(observation: Array) -> Array:
    """Insert by poses: down until it touches, then a growing spiral under a slight push until the peg drops."""
    seen = Observed(Insert(), observation)
    hand, hole, t_s = seen.vector("arm"), seen.vector("hole"), seen.seconds
    dropped = hand[:, 2] < hole[:, 2] - 0.004
    searching = ~dropped & (t_s > 1.0)
    turn = 2 * np.pi * (t_s - 1.0) / 1.0
    radius = np.clip(0.001 * (t_s - 1.0), 0, 0.0042)
    spiral = radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    where = hole[:, :2] + np.where(searching[:, None], spiral, 0)
    action = np.zeros((len(observation), 3))
    action[:, :2] = np.where(dropped[:, None], 0, 0.15 * (where - hand[:, :2]) / 0.004)
    push = seen["arm_fz [10 N]"] * 10  # negative while it presses
    down = np.where(dropped, -0.8, np.clip(-(push + 6) / 20, -0.6, 0.6))
    action[:, 2] = down
    return np.clip(action, -1, 1)


def lift(observation: Array) -> Array:
    """LiftBox by poses: squeeze, and lift once both hands press."""
    seen = Observed(LiftBox(), observation)
    height = 0.5 * (seen["left_z [m]"] + seen["right_z [m]"])
    pressed = np.minimum(np.abs(seen["left_fy [10 N]"]), np.abs(seen["right_fy [10 N]"])) > 1.2
    action = np.zeros((len(observation), 4))
    action[:, 2] = np.where(pressed & (seen.seconds > 2), 0.15 * (seen["height of the box [m]"] - height) / 0.01, 0)
    action[:, 3] = 0.25  # 25 N
    return np.clip(action, -1, 1)


def handover(observation: Array) -> Array:
    """Handover by poses: each hand goes to a place, and the grippers close and open, at fixed times."""
    seen = Observed(Handover(), observation)
    meeting, t_s = seen.vector("meeting"), seen.seconds
    left, right = seen.vector("left"), seen.vector("right")
    left_goal = meeting + [-GRASP_M, 0, 0]
    left_goal = np.where((t_s < 1.0)[:, None], left, left_goal)
    left_goal = np.where((t_s > 7.0)[:, None], left_goal - [0.2, 0, 0], left_goal)
    # The right arm's base is at 1 m and turned by half a turn.
    end = meeting + [GRASP_M, 0, 0]
    right_goal = np.column_stack([1.0 - end[:, 0], -end[:, 1], end[:, 2]])
    right_goal = np.where((t_s < 3.5)[:, None], right_goal - [0.12, 0, 0], right_goal)
    action = np.zeros((len(observation), 8))
    action[:, :3] = 15 * (left_goal - left)
    action[:, 3] = np.where(t_s < 6.2, 1, -1)
    action[:, 4:7] = 15 * (right_goal - right)
    action[:, 7] = np.where(t_s < 5.5, -1, 1)
    return np.clip(action, -1, 1)


SCRIPTED: dict[str, tuple[str, BatchPolicy]] = {
    "Reach": ("pose", reach),
    "PressCircle": ("wrench", press),
    "Insert": ("pose", insert),
    "LiftBox": ("pose", lift),
    "Handover": ("pose", handover),
}
