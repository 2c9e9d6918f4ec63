"""What a task is: a scene, its action kinds, what a policy observes, the reward, success and the end of an episode."""

from __future__ import annotations

import pathlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..rotations import Array, axes
from .actions import ActionMapping, JointsPart, ParameterPart, Part, PosePart
from .arms import ArmStates, States, in_base, wrench_in_base

SCENES = pathlib.Path(__file__).parent / "scenes"
ACTION_KINDS = ("pose", "impedance", "wrench", "joints")
# Panda's joint limits, 0.1 rad inside of them [rad].
JOINTS_LOW_RAD = (-2.79, -1.66, -2.79, -2.97, -2.79, 0.08, -2.79)
JOINTS_HIGH_RAD = (2.79, 1.66, 2.79, -0.17, 2.79, 3.65, 2.79)

Numbers = dict[str, Array]  # random numbers of the episodes: N rows by name


@dataclass
class Start:
    """How an episode of one world begins.

    Attributes:
        q_rad: Joint angles by arm [rad].
        objects: Poses of free objects by name: x y z [m], qw qx qy qz.
        numbers: Numbers of the task by name.
    """

    q_rad: dict[str, Array] = field(default_factory=dict)
    objects: dict[str, Array] = field(default_factory=dict)
    numbers: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Truth:
    """Values that only a simulation has.

    Attributes:
        wrenches: F_K_W_true by arm, N x 6 [N, N m]: what the arm exerts.
        objects: Poses of free objects by name, N x 7.
    """

    wrenches: Mapping[str, Array]
    objects: Mapping[str, Array]


@dataclass(frozen=True)
class Judgment:
    """The result of a step, per world.

    Attributes:
        reward: 0 to 1.
        success: Whether the task is done now.
        failed: Whether the episode ends for good.
        measures: Figures by name, for the info.
    """

    reward: Array
    success: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    measures: dict[str, Array]


@dataclass(frozen=True)
class TaskArm:
    """An arm of a task: its name, and X_WB as x y z qw qx qy qz."""

    name: str
    base: Array


class Task(ABC):
    """A task. Its methods work on N worlds at once; `draw` makes one episode of one world.

    Attributes:
        name: Its name, such as `Reach`.
        scene: Its scene file.
        arms: Its arms.
        actions: The action kinds that it offers.
        seconds: Length of an episode [s].
        objects: Free objects whose poses the reward uses.
        grippers: Arms whose grippers a policy sees and commands.
    """

    name: ClassVar[str]
    scene: ClassVar[pathlib.Path]
    arms: ClassVar[Sequence[TaskArm]]
    actions: ClassVar[Sequence[str]]
    seconds: ClassVar[float]
    objects: ClassVar[Sequence[str]] = ()
    grippers: ClassVar[Sequence[str]] = ()

    @abstractmethod
    def _mapping(self, kind: str) -> ActionMapping:
        """The mapping of one of its action kinds."""

    @abstractmethod
    def draw(self, random: np.random.Generator) -> Start:
        """How the next episode of a world begins."""

    @abstractmethod
    def judge(self, states: States, truth: Truth, numbers: Numbers, t_s: Array) -> Judgment:
        """The reward of the step that ends at t_s."""

    def around(self, numbers: Numbers, t_s: Array) -> Array | None:
        """The nominal pose at t_s in the frame of the first arm's base, N x 7; None if the task has none."""
        return None

    @abstractmethod
    def goal(self, numbers: Numbers, t_s: Array) -> Array:
        """Task data given to the policy at t_s, N x n."""

    @property
    @abstractmethod
    def goal_names(self) -> list[str]:
        """Names and units of these numbers."""

    def mapping(self, kind: str) -> ActionMapping:
        """The mapping of an action kind.

        Raises:
            ValueError: The task does not offer it.
        """
        if kind not in self.actions:
            raise ValueError(f"{self.name}: expected an action of {', '.join(self.actions)}; found '{kind}'")
        return self._mapping(kind)

    @staticmethod
    def _joints(law: str, arm: str, step_rad: float = 0.02, leash_rad: float = 0.15) -> JointsPart:
        limits = {"low_rad": JOINTS_LOW_RAD, "high_rad": JOINTS_HIGH_RAD}
        return JointsPart(law, arm, step_rad=step_rad, leash_rad=leash_rad, **limits)

    @staticmethod
    def _stiffness(law: str, low: float, high: float) -> ParameterPart:
        return ParameterPart(law, "translational_stiffness_n_per_m", "N/m", low, high, count=3)

    def _of_one_arm(
        self, kind: str, joints: JointsPart, force_law: str, force: Part, more: Sequence[Part], **pose: Any
    ) -> ActionMapping:
        """The mapping of a task with one arm: laws `joint`, `cartesian`, `force_law`; `impedance` adds `more`."""
        if kind == "joints":
            return ActionMapping(["joint"], [joints])
        law = force_law if kind == "wrench" else "cartesian"
        added = [force] if kind == "wrench" else more if kind == "impedance" else []
        return ActionMapping([law], [PosePart(law, "pose", ["arm"], self.arms[0].base, **pose), *added])

    @property
    def observation_names(self) -> list[str]:
        """Names and units of the numbers that `observe` returns, in order."""
        names = []
        for arm in self.arms:
            names += [f"{arm.name}_q{k + 1} [rad]" for k in range(7)]
            names += [f"{arm.name}_dq{k + 1} [rad/s]" for k in range(7)]
            names += [f"{arm.name}_{axis} [m]" for axis in "xyz"]
            names += [f"{arm.name}_{column}{row}" for column in "xy" for row in "xyz"]
            names += [f"{arm.name}_f{axis} [10 N]" for axis in "xyz"]
            names += [f"{arm.name}_m{axis} [N m]" for axis in "xyz"]
            if arm.name in self.grippers:
                names += [f"{arm.name}_width [m]", f"{arm.name}_grasped"]
        return [*names, "time of the episode, 0 to 1", *self.goal_names]

    def observe(self, states: States, numbers: Numbers, t_s: Array) -> Array:
        """What a policy observes, N x n: only what a real arm can report, in the axes of each arm's base.

        Args:
            states: The measured states.
            numbers: What the episode was drawn with.
            t_s: Time since its beginning [s].
        """
        rows = []
        for arm in self.arms:
            state: ArmStates = states[arm.name]
            pose = in_base(arm.base, state.pose)
            wrench = wrench_in_base(arm.base, state.wrench_n_nm)
            rows += [state.q_rad, state.dq_rad_per_s, pose[:, :3], axes(pose[:, 3:]), wrench[:, :3] / 10, wrench[:, 3:]]
            if arm.name in self.grippers and state.gripper is not None:
                rows.append(state.gripper)
        return np.concatenate([*rows, t_s[:, None] / self.seconds, self.goal(numbers, t_s)], axis=1)

    @property
    def privileged_names(self) -> list[str]:
        """Names and units of the numbers that `privileged` returns."""
        names = [f"{arm.name}_true_f{axis} [10 N]" for arm in self.arms for axis in "xyz"]
        for name in self.objects:
            names += [f"{name}_{part}" for part in ("x [m]", "y [m]", "z [m]", "qw", "qx", "qy", "qz")]
        return names

    def privileged(self, truth: Truth) -> Array:
        """Values that no arm reports: true contact forces and the poses of objects, in world axes."""
        forces = [truth.wrenches[arm.name][:, :3] / 10 for arm in self.arms]
        return np.concatenate([*forces, *[truth.objects[name] for name in self.objects]], axis=1)


def pose_of(position_m: Sequence[float], quaternion_wxyz: Sequence[float] = (1, 0, 0, 0)) -> Array:
    """A pose as x y z qw qx qy qz."""
    return np.array([*position_m, *quaternion_wxyz], dtype=np.float64)
