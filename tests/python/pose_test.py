#!/usr/bin/env python3
"""Poses and rotations against matrices made by Rodrigues' formula. Needs no program."""

import math
import unittest

import harness  # noqa: F401  sets the path
import multipanda as mp
import numpy as np
from multipanda.base_client import Named
from multipanda.rotations import compose, exponential, from_rpy, inverse, logarithm
from poses import homogeneous, random_pose, rodrigues


class Rotations(unittest.TestCase):
    def test_arrays_against_matrices(self):
        random = np.random.default_rng(1)
        for _ in range(200):
            (a, a_matrix), (b, b_matrix) = random_pose(random), random_pose(random)
            np.testing.assert_allclose(mp.Pose.of(compose(a, b)).matrix, a_matrix @ b_matrix, atol=1e-12)
            np.testing.assert_allclose(mp.Pose.of(inverse(a)).matrix, np.linalg.inv(a_matrix), atol=1e-12)
            vector = random.normal(size=3)
            vector *= min(1, 3.1 / np.linalg.norm(vector))
            np.testing.assert_allclose(logarithm(-exponential(vector)), vector, atol=1e-9)
        np.testing.assert_array_equal(logarithm(exponential(np.zeros((2, 3)))), np.zeros((2, 3)))
        np.testing.assert_allclose(from_rpy(np.zeros((2, 3))), [[1, 0, 0, 0]] * 2)


class Poses(unittest.TestCase):
    def setUp(self):
        self.random = np.random.default_rng(3)

    def test_every_description_is_the_same_pose(self):
        for _ in range(200):
            vector, position = self.random.normal(size=3), self.random.normal(size=3)
            expected = homogeneous(rodrigues(vector), position)
            w, x, y, z = mp.Pose.of(expected).quaternion_wxyz
            rpy = mp.Pose.of(expected).rpy_rad
            for pose in (
                mp.Pose.at(position, quaternion_wxyz=[w, x, y, z]),
                mp.Pose.at(position, quaternion_xyzw=[-x, -y, -z, -w]),
                mp.Pose.at(position, rotation=expected[:3, :3]),
                mp.Pose.at(position, rpy_rad=rpy),
                mp.Pose(position, 1.004 * np.array([w, x, y, z])),
                mp.Pose.of([*position, w, x, y, z]),
            ):
                np.testing.assert_allclose(pose.matrix, expected, atol=1e-12)
                self.assertTrue(pose.is_close(mp.Pose.of(expected)))
            np.testing.assert_allclose(mp.Pose.of(expected).quaternion_xyzw, [x, y, z, w])

    def test_roll_pitch_yaw(self):
        angles = [
            *self.random.uniform(-3, 3, (200, 3)) * [1, 0.5, 1],
            *([0.3, p, 0.7] for p in (np.pi / 2, -np.pi / 2)),
        ]
        for roll, pitch, yaw in angles:
            rotations = (rodrigues(np.array(v, dtype=float)) for v in ([0, 0, yaw], [0, pitch, 0], [roll, 0, 0]))
            expected = np.linalg.multi_dot(list(rotations))
            pose = mp.Pose.at(rpy_rad=[roll, pitch, yaw])
            np.testing.assert_allclose(pose.rotation, expected, atol=1e-12)
            np.testing.assert_allclose(mp.Pose.at(rpy_rad=pose.rpy_rad).rotation, expected, atol=1e-7)
            if abs(pitch) < 1.57:
                np.testing.assert_allclose(pose.rpy_rad, [roll, pitch, yaw], atol=1e-9)

    def test_products_inverse_and_points(self):
        for _ in range(100):
            (a, a_matrix), (b, b_matrix) = random_pose(self.random), random_pose(self.random)
            first, second, points = mp.Pose.of(a), mp.Pose.of(b), self.random.normal(size=(5, 3))
            np.testing.assert_allclose((first @ second).matrix, a_matrix @ b_matrix, atol=1e-12)
            np.testing.assert_allclose(first.inverse().matrix, np.linalg.inv(a_matrix), atol=1e-12)
            self.assertTrue((first @ first.inverse()).is_close(mp.Pose.at()))
            expected = (a_matrix @ np.column_stack([points, np.ones(5)]).T).T[:, :3]
            np.testing.assert_allclose(first @ points, expected, atol=1e-12)
            np.testing.assert_allclose(first @ points[0], expected[0], atol=1e-12)
            about_world = rodrigues(np.array([0, 0, 0.3])) @ a_matrix[:3, :3]
            turned = first.turned([0, 0, 0.3])
            np.testing.assert_allclose(turned.matrix, homogeneous(about_world, a_matrix[:3, 3]), atol=1e-12)

    def test_comparison(self):
        a = mp.Pose.at([0.1, 0.2, 0.3], rpy_rad=[0.4, 0.5, 0.6])
        self.assertEqual(a, mp.Pose(a.position_m, -a.quaternion_wxyz))
        self.assertNotEqual(a, a.moved(z=1e-9))
        self.assertNotEqual(a, "a")
        self.assertTrue(a.is_close(a.moved(z=1e-3), 2e-3))
        self.assertFalse(a.is_close(a.moved(z=3e-3), 2e-3))
        self.assertFalse(a.is_close(a.turned([0, 0, 0.02]), angle_rad=0.01))
        self.assertAlmostEqual(a.angle_to(a.turned([0, 0, 0.02])), 0.02)
        self.assertAlmostEqual(a.distance_to(a.moved(3, 0, 4)), 5)

    def test_what_is_no_pose_is_refused(self):
        unit = [1, 0, 0, 0]
        for make, message in (
            (lambda: mp.Pose([0, 0], unit), "position_m: expected 3 numbers"),
            (lambda: mp.Pose([0, 0, 0], [1, 0, 0]), "quaternion_wxyz: expected 4 numbers"),
            (lambda: mp.Pose([0, 0, 0], [0, 0, 0, 0]), "length 1, found length 0"),
            (lambda: mp.Pose([0, 0, 0], [2, 0, 0, 0]), "length 1, found length 2"),
            (lambda: mp.Pose([0, 0, math.nan], unit), "position_m: expected finite numbers"),
            (lambda: mp.Pose.of([0, 0, 0, 0, 0, 0, 0]), "length 1, found length 0"),
            (lambda: mp.Pose.of([0, 0, 0]), "found shape"),
            (lambda: mp.Pose.of(np.diag([2, 2, 2, 1])), "expected a rotation matrix"),
            (lambda: mp.Pose.of(2 * np.eye(4)), "last row 0 0 0 1, found [0.0, 0.0, 0.0, 2.0]"),
            (lambda: mp.Pose.of(mp.Pose.at([1, 2, 3]).matrix.T), "found [1.0, 2.0, 3.0, 1.0]; transpose it"),
            (lambda: mp.Pose.at() @ [1, 2], "found shape (2,)"),
            (lambda: mp.Pose.at(rotation=np.diag([1, 1, -1])), "expected a rotation matrix"),
            (lambda: mp.Pose.at(rpy_rad=[0, 0]), "rpy_rad: expected 3 numbers"),
            (lambda: mp.Pose.at(rpy_rad=[180, 0, 0]), "these look like degrees"),
            (lambda: mp.Pose.at().turned([0, 0, -90]), "these look like degrees"),
            (lambda: mp.Pose.at(rpy_rad=[0, 0, 0], quaternion_xyzw=unit), "rpy_rad and quaternion_xyzw"),
        ):
            with self.assertRaises(ValueError) as caught:
                make()
            self.assertIn(message, str(caught.exception))


class Names(unittest.TestCase):
    def test_an_unknown_name_says_what_there_is(self):
        arms = Named("arm", {"left": 1, "right": 2})
        self.assertEqual(arms["left"], 1)
        with self.assertRaisesRegex(KeyError, "no arm 'lft'; did you mean 'left'.; it has: left, right"):
            arms["lft"]
        self.assertEqual(arms.get("lft"), None)


if __name__ == "__main__":
    unittest.main()
