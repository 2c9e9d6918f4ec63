"""Insert: a peg goes into a hole whose place is not known exactly."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..rotations import Array
from .actions import ActionMapping, WrenchPart
from .arms import States, in_base
from .reach import READY_RAD
from .task import SCENES, Judgment, Numbers, Start, Task, TaskArm, Truth, pose_of

HOLE_M = np.array([0.31, 0.0, 0.345])  # the middle of the hole, at its edge
DEPTH_M, SUCCESS_M = 0.04, 0.03


class Insert(Task):
    """A square peg of 20 mm goes into a hole of 22 mm. The policy gets the hole's place with an error of up to 3 mm.

    Reward: 0.2 exp(-(distance from the hole's axis / 5 mm)^2) + 0.8 times the depth over 30 mm, at most 1. Success:
    30 mm deep.
    """

    name = "Insert"
    scene = SCENES / "insert.yaml"
    arms = (TaskArm("arm", pose_of([0, 0, 0])),)
    actions = ("pose", "impedance", "wrench", "joints")
    seconds = 8.0

    def _mapping(self, kind: str) -> ActionMapping:
        joints = self._joints("joint", "arm", step_rad=0.01, leash_rad=0.1)
        force = WrenchPart("wipe", self.arms[0].base, low_n=[-10, -10, -20], high_n=[10, 10, 0])
        pose: dict[str, Any] = {
            "step_m": 0.004,
            "low_m": [0.26, -0.05, 0.29],
            "high_m": [0.36, 0.05, 0.45],
            "leash_m": 0.03,
        }
        return self._of_one_arm(kind, joints, "wipe", force, [self._stiffness("cartesian", 150, 2000)], **pose)

    def draw(self, random: np.random.Generator) -> Start:
        error = random.uniform(-0.003, 0.003, 2)
        return Start(
            q_rad={"arm": READY_RAD + random.uniform(-0.01, 0.01, 7)},
            numbers={"hole_m": HOLE_M + np.array([*error, 0])},
        )

    @property
    def goal_names(self) -> list[str]:
        return [f"hole_{axis} [m]" for axis in "xyz"]

    def goal(self, numbers: Numbers, t_s: Array) -> Array:
        return numbers["hole_m"]

    def judge(self, states: States, truth: Truth, numbers: Numbers, t_s: Array) -> Judgment:
        tip = in_base(self.arms[0].base, states["arm"].pose)[:, :3]
        off = np.linalg.norm(tip[:, :2] - HOLE_M[:2], axis=1)
        depth = np.clip(HOLE_M[2] - tip[:, 2], 0, DEPTH_M)
        depth = np.where(off < 0.003, depth, 0)
        reward = 0.2 * np.exp(-((off / 0.005) ** 2)) + 0.8 * np.minimum(1, depth / SUCCESS_M)
        none = np.zeros(len(off), dtype=np.bool_)
        return Judgment(reward, depth >= SUCCESS_M, none, {"depth_m": depth, "off_axis_m": off})
