"""The rigid-body model of an arm at any joint angles: the numbers that the loop computes, with or without a run."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from .errors import Refused
from .pose import Pose
from .rotations import Array, conjugate, logarithm, multiply

_NONE: Mapping[str, Any] = {}
_CLOSE = 1e-9  # residual of an inverse [m, rad]
_STARTS = 30
_STEPS = 100
_LONGEST_STEP_RAD = 0.5


class ArmModel:
    """Kinematics and dynamics of one arm, with hand, tool and declared load, about its end effector E in the world W.

    `mp.model("fr3")`, `mp.model("scene.yaml", arm="left")` and `run.arms["left"].model` make one. Use it from one
    thread at a time. Every function raises ValueError for another number of joints, or a number that is not finite.

    Attributes:
        joints: Number of joints.
        home_rad: A comfortable configuration [rad].
        q_min_rad: Lower ends of the joints' ranges [rad].
        q_max_rad: Upper ends [rad].
    """

    def __init__(self, terms: Any) -> None:
        self._terms = terms
        self.joints: int = terms.joints
        self.home_rad: Array = terms.home
        self.q_min_rad: Array = terms.q_min
        self.q_max_rad: Array = terms.q_max

    def _per_joint(self, what: str, values: Any) -> Array:
        array = np.array(values, dtype=np.float64)
        if array.shape != (self.joints,) or not np.all(np.isfinite(array)):
            raise ValueError(f"{what}: expected {self.joints} finite numbers, one per joint, found {array.tolist()}")
        return array

    def pose(self, q_rad: Any) -> Pose:
        """Forward kinematics: the pose X_WE of the end effector in the world [m]."""
        values = np.array(self._terms.pose(self._per_joint("q_rad", q_rad)))
        return Pose(values[:3], values[3:])

    def jacobian(self, q_rad: Any) -> Array:
        """J_V_WE (6 x n): velocity of E's origin [m/s], then angular velocity [rad/s], both in world axes."""
        return np.array(self._terms.jacobian(self._per_joint("q_rad", q_rad)))

    def mass(self, q_rad: Any) -> Array:
        """The mass matrix M (n x n) [kg m^2]."""
        return np.array(self._terms.mass(self._per_joint("q_rad", q_rad)))

    def coriolis(self, q_rad: Any, dq_rad_per_s: Any) -> Array:
        """C(q, dq) dq (n) [N m]."""
        velocity = self._per_joint("dq_rad_per_s", dq_rad_per_s)
        return np.array(self._terms.coriolis(self._per_joint("q_rad", q_rad), velocity))

    def gravity(self, q_rad: Any) -> Array:
        """The torques g (n) that hold the arm still [N m]."""
        return np.array(self._terms.gravity(self._per_joint("q_rad", q_rad)))

    def inverse(self, pose: Any, near_rad: Any = None) -> Array:
        """Inverse kinematics: joint angles within their ranges whose pose() is this one, to 1e-9 m and 1e-9 rad.

        By damped Newton steps from `near_rad`, then from seeded random angles: of an arm with a redundant joint it is
        one of many. It ignores obstacles and the path.

        Args:
            pose: A Pose, seven numbers or a matrix, as for goals [m].
            near_rad: Initial joint angles; `home_rad` by default.

        Raises:
            Refused: No joint angles were found.
        """
        goal, random = Pose.of(pose), np.random.default_rng(1)
        best = np.inf
        q = self.home_rad if near_rad is None else self._per_joint("near_rad", near_rad)
        for _ in range(_STARTS):
            for _ in range(_STEPS):
                error = self._error(goal, q)
                left = float(np.linalg.norm(error))
                best = min(best, left)
                if left < _CLOSE:
                    return q
                J = self._terms.jacobian(q)
                step = J.T @ np.linalg.solve(J @ J.T + 1e-3 * left**2 * np.eye(6) + 1e-12 * np.eye(6), error)
                step *= min(1, _LONGEST_STEP_RAD / max(float(np.max(np.abs(step))), 1e-12))
                q = np.clip(q + step, self.q_min_rad, self.q_max_rad)
            q = random.uniform(self.q_min_rad, self.q_max_rad)
        place = goal.values.round(4).tolist()
        raise Refused(
            "out_of_bounds",
            f"no joint angles within their ranges were found for {place}; {best:.3g} m or rad are left",
            "a pose nearer to the arm, another orientation, or another near_rad",
        )

    def _error(self, goal: Pose, q: Array) -> Array:
        values = np.array(self._terms.pose(q))
        turn = logarithm(multiply(goal.quaternion_wxyz, conjugate(values[3:])))
        return np.concatenate([goal.position_m - values[:3], turn])

    def set_load(self, mass_kg: float, com_m: Any, inertia_kg_m2: Any = None) -> None:
        """The payload that it includes: mass [kg], center of mass in the flange [m], inertia about it [kg m^2]."""
        inertia = np.zeros((3, 3)) if inertia_kg_m2 is None else np.array(inertia_kg_m2, dtype=np.float64)
        self._terms.set_load(float(mass_kg), np.array(com_m, dtype=np.float64), inertia)

    def set_frames(self, end_effector: Any = None, stiffness_frame: Any = None) -> None:
        """Its end effector in the flange, and the stiffness frame in that [m]."""
        poses = (None if x is None else Pose.of(x).values.tolist() for x in (end_effector, stiffness_frame))
        self._terms.set_frames(*poses)


def model(
    name: str | os.PathLike[str],
    *,
    arm: str | None = None,
    hand: bool = True,
    base: Any = None,
    settings: Mapping[str, Any] = _NONE,
) -> ArmModel:
    """The model of an arm, without a run: of a robot, or of an arm of a scene.

    Args:
        name: A robot, such as `fr3`, or its model file; with `arm` a scene, by name or file.
        arm: Name of the arm in the scene.
        hand: Of a robot: whether it has its hand.
        base: Of a robot: pose of its base in the world [m].
        settings: Of a scene: as for run().

    Raises:
        ValueError: There is no such robot, scene or arm; or the arm stands on another one.
        ProgramMissing: The compiled part is not installed.
    """
    from multipanda_native._core import core

    if arm is not None:
        return ArmModel(core.ArmTerms(os.fspath(name), settings_words(settings), arm))
    place = Pose.at() if base is None else Pose.of(base)
    entry = {
        "name": "arm",
        "model": os.fspath(name),
        "hand": hand,
        "base": {"position_m": place.position_m.tolist(), "quaternion_wxyz": place.quaternion_wxyz.tolist()},
    }
    try:
        return ArmModel(core.ArmTerms(json.dumps({"name": "model", "arms": [entry]}), "arm"))
    except ValueError as wrong:
        why = str(wrong).rpartition("model: ")[2]
        raise ValueError(f"{why} (for an arm of a scene, name one: mp.model('{name}', arm=...))") from None


def settings_words(settings: Mapping[str, Any]) -> list[str]:
    """KEY=VALUE for each, the value as JSON, which is YAML."""
    return [f"{key}={json.dumps(value, default=lambda array: array.tolist())}" for key, value in settings.items()]
