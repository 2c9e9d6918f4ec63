"""Poses: made, combined and compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from .rotations import Array, conjugate, from_matrix, from_rpy, logarithm, matrix, multiply, rotate, to_rpy

_UNIT = 0.01  # tolerated deviation of a given quaternion from length 1
_MOST_RAD = 2.01 * np.pi  # of a given angle


def _numbers(what: str, values: Any, *shape: int) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{what}: expected {' x '.join(map(str, shape))} numbers, found an array of {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what}: expected finite numbers, found {array.tolist()}")
    return array


def _unit(what: str, values: Any) -> Array:
    quaternion = _numbers(what, values, 4)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > _UNIT:
        raise ValueError(f"{what}: expected a quaternion of length 1, found length {length:.4g}: {quaternion.tolist()}")
    return quaternion / length


def _rotation(what: str, values: Any) -> Array:
    r = _numbers(what, values, 3, 3)
    if not (np.allclose(r @ r.T, np.eye(3), atol=1e-4) and np.linalg.det(r) > 0):
        raise ValueError(f"{what}: expected a rotation matrix, found {r.tolist()}")
    return from_matrix(r)


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose: the coordinates of one frame in another. `a @ b` combines poses, `a @ point` maps a point.

    `Pose.at()` makes one from any description of an orientation.

    Attributes:
        position_m: x, y, z [m].
        quaternion_wxyz: Orientation as unit quaternion w, x, y, z; given with a length of 0.99 to 1.01.
    """

    position_m: Array
    quaternion_wxyz: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", _numbers("position_m", self.position_m, 3))
        object.__setattr__(self, "quaternion_wxyz", _unit("quaternion_wxyz", self.quaternion_wxyz))

    @classmethod
    def measured(cls, position_m: Array, quaternion_wxyz: Array) -> Pose:
        """From the numbers of a run [m], unchecked: unknown ones are not a number."""
        pose = object.__new__(cls)
        object.__setattr__(pose, "position_m", position_m)
        object.__setattr__(pose, "quaternion_wxyz", quaternion_wxyz)
        return pose

    @classmethod
    def at(
        cls,
        position_m: Any = (0, 0, 0),
        *,
        rpy_rad: Any = None,
        quaternion_wxyz: Any = None,
        quaternion_xyzw: Any = None,
        rotation: Any = None,
    ) -> Pose:
        """From a position and one description of the orientation; without any, the axes are those of the other frame.

        mp.Pose.at([0.5, 0, 0.4], rpy_rad=[np.pi, 0, 0])

        Args:
            position_m: x, y, z [m].
            rpy_rad: Roll, pitch and yaw about the fixed x, y and z axes, in this order [rad].
            quaternion_wxyz: Quaternion, its scalar first, as everywhere in multipanda.
            quaternion_xyzw: Quaternion, its scalar last, as in ROS and SciPy.
            rotation: 3 x 3 rotation matrix.

        Raises:
            ValueError: More than one orientation, another number of values, one that is not finite, an angle of more
                than one turn, a quaternion that is not of length 1, or a matrix that is not a rotation.
        """
        given = {
            "rpy_rad": rpy_rad,
            "quaternion_wxyz": quaternion_wxyz,
            "quaternion_xyzw": quaternion_xyzw,
            "rotation": rotation,
        }
        named = {name: value for name, value in given.items() if value is not None}
        if len(named) > 1:
            raise ValueError(f"expected one orientation, found {' and '.join(named)}")
        if rpy_rad is not None:
            angles = _numbers("rpy_rad", rpy_rad, 3)
            if np.abs(angles).max() > _MOST_RAD:
                raise ValueError(
                    f"rpy_rad: expected angles in radians, at most one turn; found {angles.tolist()}: these look like "
                    "degrees (math.radians)"
                )
            turned = from_rpy(angles)
        elif rotation is not None:
            turned = _rotation("rotation", rotation)
        elif quaternion_xyzw is not None:
            turned = np.roll(_unit("quaternion_xyzw", quaternion_xyzw), 1)
        else:
            turned = np.array([1.0, 0, 0, 0]) if quaternion_wxyz is None else quaternion_wxyz
        return cls(position_m, turned)

    @classmethod
    def of(cls, values: Pose | Any) -> Pose:
        """From a Pose, seven numbers x y z qw qx qy qz [m], or a homogeneous 4 x 4 matrix.

        Raises:
            ValueError: It has another shape, a number that is not finite, or no valid orientation.
        """
        if isinstance(values, Pose):
            return values
        array = np.asarray(values, dtype=np.float64)
        if array.shape == (7,):
            return cls(array[:3], array[3:])
        if array.shape == (4, 4):
            if not np.allclose(array[3], [0, 0, 0, 1], atol=1e-6):
                hint = "; transpose it" if np.allclose(array[:, 3], [0, 0, 0, 1], atol=1e-6) else ""
                raise ValueError(f"expected a 4 x 4 matrix with the last row 0 0 0 1, found {array[3].tolist()}{hint}")
            return cls.at(array[:3, 3], rotation=array[:3, :3])
        raise ValueError(f"expected a Pose, 7 numbers x y z qw qx qy qz, or a 4 x 4 matrix; found shape {array.shape}")

    @property
    def rotation(self) -> Array:
        """The 3 x 3 rotation matrix."""
        return matrix(self.quaternion_wxyz)

    @property
    def matrix(self) -> Array:
        """The homogeneous 4 x 4 matrix; translation [m]."""
        whole = np.eye(4)
        whole[:3, :3], whole[:3, 3] = self.rotation, self.position_m
        return whole

    @property
    def rpy_rad(self) -> Array:
        """Roll, pitch and yaw about the fixed x, y and z axes."""
        return to_rpy(self.quaternion_wxyz)

    @property
    def quaternion_xyzw(self) -> Array:
        """The quaternion with its scalar last, as in ROS and SciPy."""
        return np.roll(self.quaternion_wxyz, -1)

    @property
    def values(self) -> Array:
        """Seven numbers: x y z [m], qw qx qy qz."""
        return np.concatenate([self.position_m, self.quaternion_wxyz])

    @overload
    def __matmul__(self, other: Pose) -> Pose: ...
    @overload
    def __matmul__(self, other: Array) -> Array: ...

    def __matmul__(self, other: Any) -> Any:
        """X_AC = X_AB @ X_BC; of a point, or of N x 3 points, their coordinates in the other frame [m].

        Raises:
            ValueError: It is neither a pose nor points.
        """
        if not isinstance(other, Pose):
            points = np.asarray(other, dtype=np.float64)
            if points.ndim not in (1, 2) or points.shape[-1] != 3:
                raise ValueError(f"expected a Pose, a point of 3 numbers or N x 3 points, found shape {points.shape}")
            return self.position_m + rotate(self.quaternion_wxyz, points)
        return Pose(self @ other.position_m, multiply(self.quaternion_wxyz, other.quaternion_wxyz))

    def inverse(self) -> Pose:
        """The other frame in this one: pose @ pose.inverse() is Pose.at()."""
        back = conjugate(self.quaternion_wxyz)
        return Pose(-rotate(back, self.position_m), back)

    def moved(self, x: float = 0, y: float = 0, z: float = 0) -> Pose:
        """The same orientation, moved along the axes of the frame in which this pose is [m]."""
        return Pose(self.position_m + np.array([x, y, z], dtype=np.float64), self.quaternion_wxyz)

    def turned(self, rpy_rad: Any) -> Pose:
        """The same position, turned by roll, pitch and yaw about the axes of the frame in which this pose is [rad]."""
        return Pose(self.position_m, (Pose.at(rpy_rad=rpy_rad) @ self).quaternion_wxyz)

    def distance_to(self, other: Pose) -> float:
        """The distance between both positions [m]."""
        return float(np.linalg.norm(other.position_m - self.position_m))

    def angle_to(self, other: Pose) -> float:
        """The angle between both orientations [rad]."""
        between = multiply(conjugate(self.quaternion_wxyz), other.quaternion_wxyz)
        return float(np.linalg.norm(logarithm(between)))

    def is_close(self, other: Pose, position_m: float = 1e-6, angle_rad: float = 1e-6) -> bool:
        """Whether both poses are the same within a distance [m] and an angle [rad]."""
        return self.distance_to(other) <= position_m and self.angle_to(other) <= angle_rad

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are the same; q and -q are one orientation. For measured poses use is_close()."""
        if not isinstance(other, Pose):
            return NotImplemented
        a, b = self.quaternion_wxyz, other.quaternion_wxyz
        return np.array_equal(self.position_m, other.position_m) and (np.array_equal(a, b) or np.array_equal(a, -b))

    __hash__ = None  # type: ignore[assignment]  # as arrays have none
