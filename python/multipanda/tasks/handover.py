"""Handover: one arm lifts a bar with its gripper and hands it to the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..rotations import Array, compose, from_rpy
from .actions import ActionMapping, GripperPart, Part, PosePart, WrenchPart
from .arms import States
from .reach import READY_RAD
from .task import SCENES, Judgment, Numbers, Start, Task, TaskArm, Truth, pose_of

BAR_M = np.array([0.4, 0.0, 0.4755])  # where the bar lies
GRASP_M = 0.08  # from the bar's middle to where a hand grasps it
LEFT_AWAY_M, HELD_M = 0.16, 0.04


class Handover(Task):
    """The left arm grasps a bar that lies between its fingers, lifts it and brings it to a meeting point; the right arm
    grasps its other end, and the left one lets go and moves away. Actions move both hands, and open and close the
    grippers.

    Reward, by stages: 0.25 times how near the bar is to the meeting point, 0.25 times how near the right hand is to the
    bar's free end, 0.2 if the right hand grasps, 0.3 times how far the left hand is away while the right one grasps.
    Success: the right gripper grasps the bar, which is at least 2 cm above the stand, and the left hand is 16 cm away
    from its end. A bar that has fallen ends the episode.
    """

    name = "Handover"
    scene = SCENES / "handover.yaml"
    arms = (
        TaskArm("left", pose_of([0, 0, 0])),
        TaskArm("right", pose_of([1.0, 0, 0], from_rpy(np.array([0, 0, np.pi])).tolist())),
    )
    actions = ("pose", "impedance", "wrench", "joints")
    seconds = 10.0
    objects = ("bar",)
    grippers = ("left", "right")

    def _mapping(self, kind: str) -> ActionMapping:
        parts: list[Part] = []
        end = {"wrench": "force", "joints": "joint"}.get(kind, "cartesian")
        box: dict[str, Any] = {"low_m": [0.25, -0.2, 0.4], "high_m": [0.6, 0.2, 0.7]}
        for arm in self.arms:
            law = f"{arm.name}_{end}"
            if kind == "joints":
                parts.append(self._joints(law, arm.name))
            else:
                parts.append(PosePart(law, "pose", [arm.name], arm.base, step_m=0.01, leash_m=0.1, **box))
            parts.append(GripperPart(arm.name, width_m=0.04, force_n=40))
            if kind == "impedance":
                parts.append(self._stiffness(law, 100, 2000))
            if kind == "wrench":
                parts.append(WrenchPart(law, arm.base, low_n=[-5, -5, -20], high_n=[5, 5, 0]))
        return ActionMapping([f"{arm.name}_{end}" for arm in self.arms], parts)

    def draw(self, random: np.random.Generator) -> Start:
        return Start(
            q_rad={arm.name: READY_RAD + random.uniform(-0.004, 0.004, 7) for arm in self.arms},
            objects={"bar": pose_of(BAR_M + np.array([random.uniform(-0.01, 0.01), 0, 0.0005]))},
            numbers={"meeting_m": np.array([0.5, 0, 0.53]) + random.uniform(-0.02, 0.02, 3)},
        )

    @property
    def goal_names(self) -> list[str]:
        return [f"meeting_{axis} [m]" for axis in "xyz"]

    def goal(self, numbers: Numbers, t_s: Array) -> Array:
        return numbers["meeting_m"]

    def judge(self, states: States, truth: Truth, numbers: Numbers, t_s: Array) -> Judgment:
        bar = truth.objects["bar"]

        def distance(arm: str, along: float) -> Array:
            end = compose(bar, np.broadcast_to(pose_of([along, 0, 0]), bar.shape))[:, :3]
            apart: Array = np.linalg.norm(states[arm].pose[:, :3] - end, axis=1)
            return apart

        away = np.linalg.norm(bar[:, :3] - numbers["meeting_m"], axis=1)
        near, left = distance("right", GRASP_M), distance("left", -GRASP_M)
        lifted = bar[:, 2] > BAR_M[2] + 0.02
        assert states["right"].gripper is not None
        holds = (states["right"].gripper[:, 1] > 0.5) & (near < HELD_M) & lifted
        reward = 0.25 * (1 - np.tanh(away / 0.1)) + 0.25 * (1 - np.tanh(near / 0.1)) + 0.2 * holds
        reward += 0.3 * holds * np.minimum(1, left / LEFT_AWAY_M)
        measures = {"from_meeting_m": away, "left_from_bar_m": left, "right_from_bar_m": near}
        return Judgment(reward, holds & (left > LEFT_AWAY_M), bar[:, 2] < 0.3, measures)
