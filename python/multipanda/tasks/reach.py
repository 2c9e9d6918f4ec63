"""Reach: the hand goes to a point."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..rotations import Array
from .actions import ActionMapping, ParameterPart, WrenchPart
from .arms import States, in_base
from .task import SCENES, Judgment, Numbers, Start, Task, TaskArm, Truth, pose_of

READY_RAD = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
GOAL_LOW_M, GOAL_HIGH_M = np.array([0.35, -0.25, 0.3]), np.array([0.6, 0.25, 0.6])
SUCCESS_M = 0.015


class Reach(Task):
    """The hand goes to a point of a box of 25 x 50 x 30 cm over the table and stays there.

    Reward: 1 - tanh(distance / 0.1 m). Success: within 15 mm of the point.
    """

    name = "Reach"
    scene = SCENES / "reach.yaml"
    arms = (TaskArm("arm", pose_of([0, 0, 0])),)
    actions = ("pose", "impedance", "wrench", "joints")
    seconds = 4.0

    def _mapping(self, kind: str) -> ActionMapping:
        joints = self._joints("joint", "arm", step_rad=0.025)
        force = WrenchPart("force", self.arms[0].base, low_n=[-5, -5, -20], high_n=[5, 5, 0])
        damping = ParameterPart("cartesian", "damping_ratio", "", 0.5, 1.5, log=False)
        box = {"low_m": [0.25, -0.4, 0.22], "high_m": [0.7, 0.4, 0.75]}
        pose: dict[str, Any] = {"step_m": 0.0125, "step_rad": 0.05, "leash_m": 0.1, "leash_rad": 0.4, **box}
        more = [self._stiffness("cartesian", 100, 2000), damping]
        return self._of_one_arm(kind, joints, "force", force, more, **pose)

    def draw(self, random: np.random.Generator) -> Start:
        start = READY_RAD + random.uniform(-0.05, 0.05, 7)
        return Start(q_rad={"arm": start}, numbers={"point_m": random.uniform(GOAL_LOW_M, GOAL_HIGH_M)})

    @property
    def goal_names(self) -> list[str]:
        return [f"point_{axis} [m]" for axis in "xyz"]

    def goal(self, numbers: Numbers, t_s: Array) -> Array:
        return numbers["point_m"]

    def judge(self, states: States, truth: Truth, numbers: Numbers, t_s: Array) -> Judgment:
        hand = in_base(self.arms[0].base, states["arm"].pose)[:, :3]
        distance = np.linalg.norm(hand - numbers["point_m"], axis=1)
        none = np.zeros(len(distance), dtype=np.bool_)
        return Judgment(1 - np.tanh(distance / 0.1), distance < SUCCESS_M, none, {"distance_m": distance})
