"""PressCircle: the tool presses with a desired force along one half of a circle and hovers along the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rotations import Array
from .actions import ActionMapping, WrenchPart
from .arms import States, in_base
from .reach import READY_RAD
from .task import SCENES, Judgment, Numbers, Start, Task, TaskArm, Truth, pose_of

RADIUS_M, PERIOD_S, APPROACH_S = 0.05, 4.0, 0.5
FIRST_M = np.array([0.3069, 0.0])  # where the circle begins, below the tool's start
SURFACE_M = 0.36  # top of the scene's table
HOVER_M = 0.02  # height of the nominal path where it does not press
HUMPS, HUMP_M = 2, 0.03  # number and height of its humps
HALVES = 2  # it presses in the first, and hovers in the second
CHANGE_S, LEAD_S = 0.4, 0.1  # after and before a change, when only the path counts
DOWN = (0.0, 1.0, 0.0, 0.0)
FORCE_TOLERANCE_N, HEIGHT_TOLERANCE_M = 2.0, 0.0015
ACROSS_M, ALONG_M = 0.004, 0.02  # tolerances of the path


class PressCircle(Task):
    """A round tool goes round a circle of 5 cm radius in 4 s. Along the first half it presses on the surface with a
    force of 6 to 14 N; along the second half it hovers over two humps of 30 mm, 20 mm over the surface. Both are known
    to the policy; the surface's height is known to 10 mm only, the joints have friction that nothing compensates.

    Reward: exp(-(distance from the circle / 4 mm)^2 - (error along it / 20 mm)^2), times exp(-(error / 2 N)^2) of the
    true normal force while it is to press, or exp(-(error / 1.5 mm)^2) of the height while it is to hover; from
    0.1 s before to 0.4 s after each change only the path counts. Success: a step's reward is above 0.6.
    """

    name = "PressCircle"
    scene = SCENES / "press_circle.yaml"
    arms = (TaskArm("arm", pose_of([0, 0, 0])),)
    actions = ("pose", "impedance", "wrench", "joints")
    seconds = APPROACH_S + PERIOD_S

    def _mapping(self, kind: str) -> ActionMapping:
        joints, more = self._joints("joint", "arm"), [self._stiffness("cartesian", 100, 3000)]
        force = WrenchPart("wipe", self.arms[0].base, low_n=[-5, -5, -20], high_n=[5, 5, 0])
        return self._of_one_arm(kind, joints, "wipe", force, more, step_m=0.1, around=True)

    def draw(self, random: np.random.Generator) -> Start:
        numbers = {
            "force_n": random.uniform(6, 14, 1),
            "surface_error_m": random.uniform(-0.01, 0.01, 1),
            "turn": np.where(random.uniform(size=1) < 0.5, -1.0, 1.0),
        }
        return Start(q_rad={"arm": READY_RAD + random.uniform(-0.01, 0.01, 7)}, numbers=numbers)

    @staticmethod
    def _angle(t_s: Array) -> Array:
        along: Array = np.clip((t_s - APPROACH_S) / PERIOD_S, 0, 1)
        return 2 * np.pi * along

    def _presses(self, t_s: Array) -> NDArray[np.bool_]:
        pressing: NDArray[np.bool_] = (t_s >= APPROACH_S) & (t_s < APPROACH_S + PERIOD_S / HALVES)
        return pressing

    def around(self, numbers: Numbers, t_s: Array) -> Array:
        angle = self._angle(t_s)
        pose = np.empty((len(t_s), 7))
        pose[:, 0] = FIRST_M[0] + RADIUS_M * (1 - np.cos(angle))
        pose[:, 1] = FIRST_M[1] + RADIUS_M * np.sin(angle) * numbers["turn"][:, 0]
        hump = HUMP_M * 0.5 * (1 - np.cos(HALVES * HUMPS * np.maximum(angle - np.pi, 0)))
        height = np.where(self._presses(t_s), 0, HOVER_M + hump)
        pose[:, 2] = SURFACE_M + numbers["surface_error_m"][:, 0] + height
        pose[:, 3:] = DOWN
        return pose

    @property
    def goal_names(self) -> list[str]:
        return [
            *[f"path_{axis} [m]" for axis in "xyz"],
            "sin(angle)",
            "cos(angle)",
            "desired force [10 N], 0 for hovering",
            "turn, 1 or -1",
        ]

    def goal(self, numbers: Numbers, t_s: Array) -> Array:
        angle = self._angle(t_s)
        force = np.where(self._presses(t_s), numbers["force_n"][:, 0] / 10, 0)
        path = self.around(numbers, t_s)[:, :3]
        return np.column_stack([path, np.sin(angle), np.cos(angle), force, numbers["turn"][:, 0]])

    def _path_errors(self, tip: Array, numbers: Numbers, t_s: Array) -> tuple[Array, Array]:
        """Distances from the circle, and along it from where the tip should be now."""
        turn, angle = numbers["turn"][:, 0], self._angle(t_s)
        x, y = FIRST_M[0] + RADIUS_M - tip[:, 0], (tip[:, 1] - FIRST_M[1]) * turn
        behind = (np.arctan2(y, x) - angle + np.pi) % (2 * np.pi) - np.pi
        return np.hypot(x, y) - RADIUS_M, RADIUS_M * behind

    def judge(self, states: States, truth: Truth, numbers: Numbers, t_s: Array) -> Judgment:
        tip = in_base(self.arms[0].base, states["arm"].pose)[:, :3]
        path = self.around(numbers, t_s)
        across, along = self._path_errors(tip, numbers, t_s)
        force_error = -truth.wrenches["arm"][:, 2] - numbers["force_n"][:, 0]
        height_error = tip[:, 2] - path[:, 2]
        pressing = self._presses(t_s)
        press = np.exp(-((force_error / FORCE_TOLERANCE_N) ** 2))
        hover = np.exp(-((height_error / HEIGHT_TOLERANCE_M) ** 2))
        phase = (t_s - APPROACH_S) % (PERIOD_S / HALVES)
        changing = (phase < CHANGE_S) | (phase > PERIOD_S / HALVES - LEAD_S)
        on_path = np.exp(-((across / ACROSS_M) ** 2) - (along / ALONG_M) ** 2)
        reward = on_path * np.where(changing, 1, np.where(pressing, press, hover))
        none = np.zeros(len(across), dtype=np.bool_)
        measures = {
            "path_error_m": across,
            "force_error_n": np.where(pressing, force_error, 0),
            "height_error_m": np.where(pressing, 0, height_error),
        }
        return Judgment(reward, reward > 0.6, none, measures)
