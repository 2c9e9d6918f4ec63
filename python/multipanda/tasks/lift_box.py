"""LiftBox: two arms squeeze a box between their pads and lift it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..rotations import Array, rotate
from .actions import ActionMapping, Part, PosePart, ScalarPart, WrenchPart
from .arms import States
from .task import SCENES, Judgment, Numbers, Start, Task, TaskArm, Truth, pose_of

LEFT_RAD = np.array([0.17439, 0.12345, -0.01783, -2.0577, -0.9564, 1.50686, 1.71419])
MIRROR = np.array([-1, 1, -1, 1, -1, 1, -1])
BOX_M = np.array([0.5, 0.0, 0.35])  # where it stands
SUCCESS_M, SUCCESS_RAD = 0.015, 0.15


class LiftBox(Task):
    """Two arms squeeze a box of 1 kg and lift it by 5 to 15 cm; its mass is not declared. With `pose` and `impedance`,
    one law couples both arms: actions move the frame of the box and set the squeeze. With `wrench` and `joints`, each
    arm has a law of its own.

    Reward: 1 - tanh(error of the box's height / 0.05 m), zero while the box is tilted by more than 0.5 rad. Success:
    within 15 mm of the height and 0.15 rad of upright. A box that has fallen ends the episode.
    """

    name = "LiftBox"
    scene = SCENES / "lift_box.yaml"
    arms = (TaskArm("left", pose_of([0, 0.26, 0])), TaskArm("right", pose_of([0, -0.26, 0])))
    actions = ("pose", "impedance", "wrench", "joints")
    seconds = 7.0
    objects = ("box",)

    def _mapping(self, kind: str) -> ActionMapping:
        if kind == "joints":
            return ActionMapping(
                [f"{arm.name}_joint" for arm in self.arms],
                [self._joints(f"{arm.name}_joint", arm.name) for arm in self.arms],
            )
        box: dict[str, Any] = {"low_m": [0.4, -0.1, 0.3], "high_m": [0.6, 0.1, 0.6]}
        if kind == "wrench":
            forces: list[Part] = []
            wide: dict[str, Any] = {"low_m": [0.35, -0.5, 0.25], "high_m": [0.65, 0.5, 0.65]}
            for arm in self.arms:
                law = f"{arm.name}_force"
                inwards = (-40, 0) if arm.name == "left" else (0, 40)  # the law presses that way only
                forces.append(PosePart(law, "pose", [arm.name], arm.base, step_m=0.01, leash_m=0.1, **wide))
                forces.append(WrenchPart(law, arm.base, low_n=[-10, inwards[0], -10], high_n=[10, inwards[1], 10]))
            return ActionMapping([f"{arm.name}_force" for arm in self.arms], forces)
        hands, world = ["left", "right"], pose_of([0, 0, 0])
        pose = PosePart("grasp", "pose", hands, world, step_m=0.01, axes_of_world=True, **box)
        more = [self._stiffness("grasp", 150, 2000)] if kind == "impedance" else []
        return ActionMapping(["grasp"], [pose, ScalarPart("grasp", "squeeze", "N", 0, 40), *more])

    def draw(self, random: np.random.Generator) -> Start:
        shift = random.uniform(-0.004, 0.004, 2)
        return Start(
            q_rad={
                "left": LEFT_RAD + random.uniform(-0.003, 0.003, 7),
                "right": MIRROR * LEFT_RAD + random.uniform(-0.003, 0.003, 7),
            },
            objects={"box": pose_of([BOX_M[0] + shift[0], BOX_M[1] + shift[1], BOX_M[2] + 0.0005])},
            numbers={"height_m": BOX_M[2] + random.uniform(0.05, 0.15, 1)},
        )

    @property
    def goal_names(self) -> list[str]:
        return ["height of the box [m]"]

    def goal(self, numbers: Numbers, t_s: Array) -> Array:
        return numbers["height_m"]

    def judge(self, states: States, truth: Truth, numbers: Numbers, t_s: Array) -> Judgment:
        box = truth.objects["box"]
        error = np.abs(box[:, 2] - numbers["height_m"][:, 0])
        upright = rotate(box[:, 3:], np.broadcast_to([0.0, 0.0, 1.0], (len(box), 3)))[:, 2]
        tilt = np.arccos(np.clip(upright, -1, 1))
        reward = np.where(tilt < 0.5, 1 - np.tanh(error / 0.05), 0)
        success = (error < SUCCESS_M) & (tilt < SUCCESS_RAD)
        return Judgment(reward, success, box[:, 2] < 0.2, {"height_error_m": error, "tilt_rad": tilt})
