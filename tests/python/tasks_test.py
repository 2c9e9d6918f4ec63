#!/usr/bin/env python3
"""The mapping from actions to set-points, against rotation matrices and closed forms; what tasks declare."""

import math
import unittest

import harness  # first: it sets the paths
import numpy as np
from harness import ROOT
from multipanda import Pose
from multipanda.tasks import (
    TASKS,
    ActionMapping,
    ArmStates,
    GripperPart,
    JointsPart,
    ParameterPart,
    PosePart,
    ScalarPart,
    WrenchPart,
)
from multipanda.tasks.rotations import compose, exponential, from_rpy, inverse, logarithm


def rodrigues(vector):
    """The rotation matrix of a rotation vector, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def homogeneous(rotation, position):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def random_pose(random):
    """A pose as seven numbers and as a matrix, made from Rodrigues' formula."""
    matrix = homogeneous(rodrigues(random.normal(size=3)), random.normal(size=3))
    return Pose.of(matrix).values, matrix


def states_of(poses, joints=None):
    count = len(poses)
    q = np.zeros((count, 7)) if joints is None else joints
    return ArmStates(q, np.zeros((count, 7)), np.asarray(poses), np.zeros((count, 6)), np.zeros((count, 2)))


class Rotations(unittest.TestCase):
    def test_against_matrices(self):
        random = np.random.default_rng(1)
        for _ in range(200):
            (a, a_matrix), (b, b_matrix) = random_pose(random), random_pose(random)
            np.testing.assert_allclose(Pose.of(compose(a, b)).matrix, a_matrix @ b_matrix, atol=1e-12)
            np.testing.assert_allclose(Pose.of(inverse(a)).matrix, np.linalg.inv(a_matrix), atol=1e-12)
            vector = random.normal(size=3)
            vector *= min(1, 3.1 / np.linalg.norm(vector))
            quaternion = exponential(vector)
            np.testing.assert_allclose(Pose(np.zeros(3), quaternion).rotation, rodrigues(vector), atol=1e-12)
            np.testing.assert_allclose(logarithm(-quaternion), vector, atol=1e-9)
            roll, pitch, yaw = random.uniform(-1.5, 1.5, 3)
            expected = rodrigues(np.array([0, 0, yaw])) @ rodrigues(np.array([0, pitch, 0])) @ rodrigues([roll, 0, 0])
            got = Pose(np.zeros(3), from_rpy(np.array([roll, pitch, yaw]))).rotation
            np.testing.assert_allclose(got, expected, atol=1e-12)

    def test_no_rotation(self):
        np.testing.assert_array_equal(logarithm(exponential(np.zeros((2, 3)))), np.zeros((2, 3)))


class Mapping(unittest.TestCase):
    """Every expected number comes from homogeneous matrices, with bases turned and moved at random."""

    def test_steps_of_a_pose(self):
        random = np.random.default_rng(2)
        for _ in range(50):
            base, base_matrix = random_pose(random)
            hands = [random_pose(random) for _ in range(3)]
            part = PosePart("law", "pose", ["arm"], base, step_m=0.02, step_rad=0.1)
            mapping = ActionMapping(["law"], [part])
            self.assertEqual(mapping.size, 6)
            states = {"arm": states_of([pose for pose, _ in hands])}
            mapping.reset(states)
            in_base = [np.linalg.inv(base_matrix) @ matrix for _, matrix in hands]
            for _ in range(3):
                action = random.uniform(-1, 1, (3, 6))
                target = mapping.command(action, states).targets["law", "pose"]
                for k in range(3):
                    in_base[k] = homogeneous(
                        rodrigues(0.1 * action[k, 3:]) @ in_base[k][:3, :3], in_base[k][:3, 3] + 0.02 * action[k, :3]
                    )
                    np.testing.assert_allclose(Pose.of(target[k]).matrix, base_matrix @ in_base[k], atol=1e-9)

    def test_moved_bases_move_the_set_points(self):
        """The same action of an arm whose base is elsewhere is the same motion, seen from there."""
        random = np.random.default_rng(3)
        action = random.uniform(-1, 1, (1, 6))
        seen = []
        hand = random_pose(random)[0]
        for _ in range(4):
            base, base_matrix = random_pose(random)
            mapping = ActionMapping(["law"], [PosePart("law", "pose", ["arm"], base, step_m=0.02, step_rad=0.1)])
            states = {"arm": states_of([compose(base, hand)])}
            mapping.reset(states)
            target = mapping.command(action, states).targets["law", "pose"][0]
            seen.append(np.linalg.inv(base_matrix) @ Pose.of(target).matrix)
        for other in seen[1:]:
            np.testing.assert_allclose(other, seen[0], atol=1e-12)

    def test_around_a_nominal_pose_within_a_box(self):
        base, base_matrix = random_pose(np.random.default_rng(4))
        part = PosePart("law", "pose", ["arm"], base, step_m=0.1, around=True, low_m=[0, 0, 0], high_m=[1, 1, 0.45])
        mapping = ActionMapping(["law"], [part])
        states = {"arm": states_of([random_pose(np.random.default_rng(5))[0]])}
        mapping.reset(states)
        nominal = np.array([[0.5, 0.05, 0.4, 0, 1, 0, 0]])
        for _ in range(2):  # nothing accumulates
            target = mapping.command(np.array([[0.5, -1, 1]]), states, nominal).targets["law", "pose"][0]
            expected = base_matrix @ homogeneous(rodrigues(np.array([math.pi, 0, 0])), [0.55, 0, 0.45])
            np.testing.assert_allclose(Pose.of(target).matrix, expected, atol=1e-12)
        with self.assertRaisesRegex(ValueError, "nominal pose"):
            mapping.command(np.zeros((1, 3)), states)

    def test_leash(self):
        """A hand that is blocked keeps its set-point near: its force stays what the leash allows."""
        part = PosePart(
            "law",
            "pose",
            ["arm"],
            np.array([0, 0, 0, 1.0, 0, 0, 0]),
            step_m=0.02,
            step_rad=0.3,
            leash_m=0.05,
            leash_rad=0.4,
        )
        mapping = ActionMapping(["law"], [part])
        states = {"arm": states_of([[0.1, 0.2, 0.3, 1, 0, 0, 0]])}
        mapping.reset(states)
        for _ in range(10):
            target = mapping.command(np.array([[1, 0, 0, 0, 0, 1.0]]), states).targets["law", "pose"][0]
        np.testing.assert_allclose(target[:3], [0.15, 0.2, 0.3], atol=1e-12)
        np.testing.assert_allclose(target[3:], [math.cos(0.2), 0, 0, math.sin(0.2)], atol=1e-12)
        target = mapping.command(np.array([[-1.0, 0, 0, 0, 0, -1]]), states).targets["law", "pose"][0]
        np.testing.assert_allclose(target[:3], [0.13, 0.2, 0.3], atol=1e-12)  # it comes back at once
        np.testing.assert_allclose(target[3:], [math.cos(0.05), 0, 0, math.sin(0.05)], atol=1e-12)

    def test_between_two_hands(self):
        part = PosePart("law", "pose", ["a", "b"], np.array([0, 0, 0, 1.0, 0, 0, 0]), step_m=0.01, axes_of_world=True)
        mapping = ActionMapping(["law"], [part])
        states = {"a": states_of([[0.5, 0.2, 0.3, 0, 1, 0, 0]]), "b": states_of([[0.5, -0.1, 0.4, 0, 0, 1, 0]])}
        mapping.reset(states)
        target = mapping.command(np.array([[0, 1.0, 0]]), states).targets["law", "pose"][0]
        np.testing.assert_allclose(target, [0.5, 0.06, 0.35, 1, 0, 0, 0], atol=1e-12)

    def test_joints(self):
        part = JointsPart("law", "arm", step_rad=0.1, low_rad=[-1] * 7, high_rad=[0.25] * 7, leash_rad=0.15)
        mapping = ActionMapping(["law"], [part])
        states = {"arm": states_of([[0, 0, 0, 1, 0, 0, 0]], np.full((1, 7), 0.2))}
        mapping.reset(states)
        self.assertAlmostEqual(mapping.command(np.full((1, 7), 0.3), states).targets["law", "joints"][0, 0], 0.23)
        self.assertAlmostEqual(mapping.command(np.full((1, 7), 1.0), states).targets["law", "joints"][0, 0], 0.25)
        for _ in range(9):
            target = mapping.command(np.full((1, 7), -1.0), states).targets["law", "joints"][0, 0]
        self.assertAlmostEqual(target, 0.05)

    def test_wrench_in_a_turned_base(self):
        base, matrix = random_pose(np.random.default_rng(6))
        mapping = ActionMapping(["law"], [WrenchPart("law", base, low_n=[-5, -5, -20], high_n=[5, 5, 0])])
        states = {"arm": states_of([[0, 0, 0, 1, 0, 0, 0]])}
        got = mapping.command(np.array([[1, 0, -0.5]]), states).targets["law", "wrench"][0]
        np.testing.assert_allclose(got, [*(matrix[:3, :3] @ [5, 0, -15]), 0, 0, 0], atol=1e-12)

    def test_parameters_and_scalars(self):
        parts = [
            ScalarPart("law", "squeeze", "N", 0, 40),
            ParameterPart("law", "translational_stiffness_n_per_m", "N/m", 100, 1600, count=3),
            ParameterPart("law", "damping_ratio", "", 0.5, 1.5, log=False),
        ]
        mapping = ActionMapping(["law"], parts)
        states = {"arm": states_of([[0, 0, 0, 1, 0, 0, 0]])}
        command = mapping.command(np.array([[-0.5, -1, 0, 1, 9.0]]), states)
        np.testing.assert_allclose(command.targets["law", "squeeze"], [[10]])
        stiffness = command.parameters["law", "translational_stiffness_n_per_m"]
        np.testing.assert_allclose(stiffness, [[100, math.sqrt(100 * 1600), 1600]])
        np.testing.assert_allclose(command.parameters["law", "damping_ratio"], [[1.5]])  # clipped

    def test_gripper(self):
        mapping = ActionMapping([], [GripperPart("arm", width_m=0.04, force_n=30)])
        states = {"arm": states_of([[0, 0, 0, 1.0, 0, 0, 0]])}
        mapping.reset(states)
        expected = {0.1: [0.078, 0], 0.5: [0.04, 30], -0.1: [0.04, 30], -0.5: [0.078, 0]}
        for action, command in expected.items():
            np.testing.assert_array_equal(mapping.command(np.array([[action]]), states).grippers["arm"], [command])

    def test_only_the_worlds_of_a_mask_begin_anew(self):
        part = PosePart("law", "pose", ["arm"], np.array([0, 0, 0, 1.0, 0, 0, 0]), step_m=0.1)
        mapping = ActionMapping(["law"], [part])
        states = {"arm": states_of([[0, 0, 0, 1.0, 0, 0, 0]] * 2)}
        mapping.reset(states)
        mapping.command(np.ones((2, 3)), states)
        mapping.reset(states, np.array([False, True]))
        target = mapping.command(np.zeros((2, 3)), states).targets["law", "pose"]
        np.testing.assert_allclose(target[:, 0], [0.1, 0])

    def test_wrong_actions(self):
        mapping = TASKS["Reach"]().mapping("pose")
        states = {"arm": states_of([[0, 0, 0, 1, 0, 0, 0]])}
        mapping.reset(states)
        for action, said in (
            (np.zeros((1, 5)), "6 numbers"),
            (np.full((1, 6), math.nan), "finite"),
            (np.zeros(6), "6"),
        ):
            with self.assertRaisesRegex(ValueError, said):
                mapping.command(action, states)
        with self.assertRaisesRegex(ValueError, "pose, impedance, joints; found 'wrench'"):
            TASKS["Reach"]().mapping("wrench")


class Tasks(unittest.TestCase):
    def test_what_they_declare(self):
        self.assertGreaterEqual(len(TASKS), 4)
        for name, kind in TASKS.items():
            task = kind()
            self.assertEqual(task.name, name)
            self.assertTrue(task.scene.exists())
            self.assertIn("Reward", kind.__doc__)
            self.assertIn("Success", kind.__doc__)
            start = task.draw(np.random.default_rng(1))
            numbers = {key: np.repeat(value[None], 2, 0) for key, value in start.numbers.items()}
            states = {arm.name: states_of([[0.4, 0, 0.4, 0, 1, 0, 0]] * 2) for arm in task.arms}
            observed = task.observe(states, numbers, np.array([0.0, 1.0]))
            self.assertEqual(observed.shape, (2, len(task.observation_names)))
            self.assertEqual(len(set(task.observation_names)), len(task.observation_names))
            for action in task.actions:
                mapping = task.mapping(action)
                self.assertEqual(mapping.cycles, 50)
                for quantity in mapping.quantities:
                    self.assertLess(quantity.low, quantity.high)
                text = task.scene.read_text(encoding="utf-8")
                for controllet in mapping.controllets:
                    self.assertIn(f"name: {controllet}", text)

    def test_they_are_listed(self):
        page = (ROOT / "docs" / "gymnasium.md").read_text(encoding="utf-8")
        for name in TASKS:
            self.assertIn(f"multipanda/{name}-v0", page)


if __name__ == "__main__":
    harness.main()
