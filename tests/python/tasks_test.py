#!/usr/bin/env python3
"""The mapping from actions to set-points, against rotation matrices and closed forms; what tasks declare."""

import contextlib
import math
import threading
import types
import unittest
import unittest.mock

import harness  # first: it sets the paths
import numpy as np
from harness import ROOT
from multipanda import ArmState, GripperState, Pose, Refused, RunState, Timeout
from multipanda.rotations import compose
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
    drive as driving,
)
from poses import homogeneous, random_pose, rodrigues


def states_of(poses, joints=None):
    count = len(poses)
    q = np.zeros((count, 7)) if joints is None else joints
    return ArmStates(q, np.zeros((count, 7)), np.asarray(poses), np.zeros((count, 6)), np.zeros((count, 2)))


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

    def test_what_a_gripper_holds_at_the_start_stays_held(self):
        mapping = ActionMapping([], [GripperPart("arm", width_m=0.04, force_n=30)])
        states = {"arm": states_of([[0, 0, 0, 1.0, 0, 0, 0]] * 2)}
        states["arm"].gripper[:] = [[0.04, 1], [0.04, 0]]
        mapping.reset(states)
        got = mapping.command(np.zeros((2, 1)), states).grippers["arm"]
        np.testing.assert_array_equal(got, [[0.04, 30], [0.078, 0]])

    def test_how_far_set_points_are_from_hands(self):
        random = np.random.default_rng(7)
        base, base_matrix = random_pose(random)
        nominal = Pose.of(base_matrix @ homogeneous(rodrigues([0, 0, 0.5]), [0.3, 0.4, 0])).values
        part = PosePart("law", "pose", ["arm"], base, step_m=0.1, around=True)
        mapping = ActionMapping(["law"], [part])
        states = {"arm": states_of([nominal])}
        mapping.reset(states)
        mapping.command(np.zeros((1, 3)), states, np.array([[0, 0, 0, 1.0, 0, 0, 0]]))
        np.testing.assert_allclose(mapping.away(states), [0.5, 0.5], atol=1e-9)

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
        with self.assertRaisesRegex(ValueError, "pose, impedance, wrench, joints; found 'torque'"):
            TASKS["Reach"]().mapping("torque")


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
        page = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
        for name in TASKS:
            self.assertIn(f"multipanda/{name}-v0", page)


class FakeRun:
    """A run as `drive` sees it, on a clock of its own: it notes what is sent, and its hands follow set-points."""

    def __init__(self, task, poses, gripper=None):
        self.now, self.said, self.task = 0.0, [], task
        self.poses, self.gripper = dict(poses), gripper
        self.parameters = {"translational_stiffness_n_per_m": 600.0, "damping_ratio": 1.0}
        self.owner = {arm.name: f"{arm.name}_hold" for arm in task.arms}
        self.stopped = set()
        self.arms = {
            arm.name: types.SimpleNamespace(base=Pose.of(arm.base), gripper=FakeGripper(self, arm.name))
            for arm in task.arms
        }

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds

    def state(self):
        zeros = np.zeros(7)
        arms = {
            name: ArmState(
                name, self.now, self.owner[name], "move", name in self.stopped, zeros, zeros, zeros, zeros,
                Pose.of(pose), np.zeros(6), 0.0, (), "", 0, "", "", self.gripper,
            )
            for name, pose in self.poses.items()
        }  # fmt: skip
        return RunState("fake", 1, self.now, 0.0, 1000, 1, 0, arms)

    def switch(self, activate):
        self.said.append(("switch", self.now))
        for name in self.owner:
            self.owner[name] = next((law for law in activate if law.startswith(name)), activate[0])

    def take_arms_from(self, controllets):
        self.said.append(("held", self.now))
        self.owner = {name: f"{name}_hold" for name in self.owner}

    def ask(self, request, patience_s):
        self.said.append((f"{request['action']} {request['arm']}", self.now))
        self.arms[request["arm"]].gripper.stopped.set()

    def __getitem__(self, name):
        return FakeControllet(self, name)

    def what(self):
        return [what for what, _ in self.said]


class FakeGripper:
    """Its motions end when they are stopped."""

    def __init__(self, run, arm):
        self.run, self.arm, self.stopped = run, arm, threading.Event()

    def move(self, width_m):
        self.run.said.append((f"move {self.arm}", self.run.now))

    def grasp(self, width_m, force_n):
        self.run.said.append((f"grasp {self.arm}", self.run.now))
        self.stopped.wait(harness.PATIENCE)


class FakeControllet:
    def __init__(self, run, name):
        self.run, self.name, self.parameters = run, name, run.parameters

    def input(self, name):
        return {"timeout_s": 0.3}

    @contextlib.contextmanager
    def stream(self, name):
        def send(values):
            self.run.said.append((f"sample {self.name}", self.run.now))

        yield types.SimpleNamespace(send=send)

    def set(self, name, value):
        self.run.said.append((f"set {name}", self.run.now))
        self.run.parameters[name] = value


HAND = [0.4, 0, 0.45, 0, 1, 0, 0]


class Driving(unittest.TestCase):
    """What `drive` sends, and above all what it does not, when something goes wrong."""

    def drive(self, run, policy, numbers=None, **options):
        numbers = {"point_m": np.array([0.5, 0, 0.4])} if numbers is None else numbers
        with unittest.mock.patch.object(driving, "time", run):
            return driving.drive(run, run.task, policy, driving.Start(numbers=numbers), **options)

    def reach(self):
        return FakeRun(TASKS["Reach"](), {"arm": HAND})

    def handover(self, gripper):
        right = [0.6, 0, 0.45, 0, 0, 1, 0]
        return FakeRun(TASKS["Handover"](), {"left": HAND, "right": right}, gripper)

    def test_an_episode(self):
        run = self.reach()
        done = self.drive(run, lambda seen: np.zeros(6), seconds=0.5)
        self.assertEqual(run.what(), ["switch", *["sample cartesian"] * 10, "held"])
        sent = [t for what, t in run.said if what == "sample cartesian"]
        np.testing.assert_allclose(np.diff(sent), 0.05)
        np.testing.assert_allclose(done.t_s, 0.05 * np.arange(10))
        self.assertEqual(done.latest_s, 0)

    def test_a_wrong_first_action_switches_nothing(self):
        def raises(seen):
            raise RuntimeError("no policy")

        for policy, error in (
            (raises, RuntimeError),
            (lambda seen: np.full(6, math.nan), ValueError),
            (lambda seen: np.zeros(5), ValueError),
            (lambda seen: np.zeros((1, 6)), ValueError),
        ):
            run = self.reach()
            with self.assertRaises(error):
                self.drive(run, policy)
            self.assertEqual(run.what(), [])

    def test_whatever_ends_it_the_arms_are_held(self):
        for error in (RuntimeError, KeyboardInterrupt):
            run, calls = self.reach(), iter(range(100))

            def policy(seen, calls=calls, error=error):
                if next(calls) == 3:
                    raise error
                return np.zeros(6)

            with self.assertRaises(error):
                self.drive(run, policy)
            self.assertEqual(run.what(), ["switch", *["sample cartesian"] * 3, "held"])

    def test_no_action_is_made_up_for(self):
        """A call that takes 0.22 s delays all after it; two samples never come within one period."""
        run, calls = self.reach(), iter(range(100))

        def policy(seen):
            run.now += 0.22 if next(calls) in (0, 4) else 0.01
            return np.zeros(6)

        done = self.drive(run, policy, seconds=0.5)
        sent = [t for what, t in run.said if what == "sample cartesian"]
        self.assertEqual(len(sent), 10)
        self.assertGreater(min(np.diff(sent)), 0.05 - 0.011)
        self.assertGreater(done.latest_s, 0.1)

    def test_an_old_action_is_not_sent(self):
        """While the policy hung, a person may have moved the arm and switched back."""
        run, calls = self.reach(), iter(range(100))

        def policy(seen):
            run.now += 0.31 if next(calls) == 2 else 0
            return np.zeros(6)

        with self.assertRaisesRegex(Timeout, "action 2 came 0.31 s"):
            self.drive(run, policy)
        self.assertEqual(run.what(), ["switch", *["sample cartesian"] * 2, "held"])

    def test_far_from_the_start(self):
        numbers = {"force_n": np.array([10.0]), "surface_error_m": np.zeros(1), "turn": np.ones(1)}
        for hand in ([0.3069, 0.2, 0.37, 0, 1, 0, 0], [0.3069, 0, 0.37, 0, 0.8, 0.6, 0]):
            run = FakeRun(TASKS["PressCircle"](), {"arm": hand})
            with self.assertRaisesRegex(Refused, "near the task's start"):
                self.drive(run, lambda seen: np.zeros(3), numbers)
            self.assertEqual(run.what(), [])
        run = FakeRun(TASKS["Reach"](), {"arm": [0.4, 0.6, 0.45, 0, 1, 0, 0]})  # outside of its box
        with self.assertRaisesRegex(Refused, "near the task's start"):
            self.drive(run, lambda seen: np.zeros(6))
        self.assertEqual(run.what(), [])

    def test_a_blocked_hand_ends_a_path_that_goes_on(self):
        """PressCircle's path has no leash of its own; this hand does not move at all."""
        numbers = {"force_n": np.array([10.0]), "surface_error_m": np.zeros(1), "turn": np.ones(1)}
        run = FakeRun(TASKS["PressCircle"](), {"arm": [0.3069, 0, 0.37, 0, 1, 0, 0]})
        with self.assertRaisesRegex(Refused, "blocks"):
            self.drive(run, lambda seen: np.zeros(3), numbers, leash_m=0.06)
        # On the circle of 5 cm radius 6 cm are reached at an angle of 2 asin(0.6), a little earlier with the height.
        at_s = 0.5 + 4 * 2 * math.asin(0.6) / (2 * math.pi)
        self.assertAlmostEqual(len(run.what()) / 20, at_s, delta=0.1)
        self.assertEqual(run.what()[-1], "held")

    def test_another_base(self):
        for moved in ([0.02, 0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, 1]):
            run = self.reach()
            run.arms["arm"].base = Pose.of(moved)
            with self.assertRaisesRegex(Refused, "base"):
                self.drive(run, lambda seen: np.zeros(6))
            self.assertEqual(run.what(), [])

    def test_another_rate(self):
        run = self.reach()
        with self.assertRaisesRegex(ValueError, "20 actions per second"):
            self.drive(run, lambda seen: np.zeros(6), rate_hz=100)
        self.assertEqual(run.what(), [])

    def test_parameters_are_given_back(self):
        for seconds, error in ((0.2, None), (0.2, RuntimeError)):
            run, calls = self.reach(), iter(range(100))

            def policy(seen, calls=calls, error=error):
                if next(calls) == 2 and error is not None:
                    raise error
                return np.ones(10)

            with self.assertRaises(error) if error else contextlib.nullcontext():
                self.drive(run, policy, action="impedance", seconds=seconds)
            self.assertIn("set translational_stiffness_n_per_m", run.what()[: run.what().index("held")])
            self.assertEqual(run.parameters, {"translational_stiffness_n_per_m": 600, "damping_ratio": 1})

    def test_after_a_stop_nothing_moves(self):
        """One of two arms is stopped while the policy thinks: no sample and no grasp follows, for neither arm."""
        run, calls = self.handover(GripperState(0.08, 0.08, False, False)), iter(range(100))

        def policy(seen):
            opens = np.array([0, 0, 0, -1, 0, 0, 0, -1.0])
            if next(calls) != 3:
                return opens
            run.stopped.add("left")
            run.owner["left"] = "left_hold"
            return -opens

        with self.assertRaisesRegex(Refused, "'left' has been stopped"):
            self.drive(run, policy, {"meeting_m": np.array([0.5, 0, 0.53])})
        self.assertEqual(run.what().count("sample right_cartesian"), 3)
        self.assertNotIn("grasp left", run.what())
        self.assertNotIn("grasp right", run.what())

    def test_fingers_that_move_are_stopped(self):
        """After an exception, and after the arms are held."""
        run, calls = self.handover(GripperState(0.08, 0.08, False, False)), iter(range(100))

        def policy(seen):
            if next(calls) == 3:
                raise RuntimeError
            return np.array([0, 0, 0, 1, 0, 0, 0, -1.0])

        with self.assertRaises(RuntimeError):
            self.drive(run, policy, {"meeting_m": np.array([0.5, 0, 0.53])})
        self.assertEqual(run.what()[-2:], ["held", "stop left"])

    def test_a_missing_gripper_shifts_no_numbers(self):
        run = self.handover(None)
        with self.assertRaisesRegex(Refused, "gripper of 'left'"):
            self.drive(run, lambda seen: np.zeros(8), {"meeting_m": np.array([0.5, 0, 0.53])})
        self.assertEqual(run.what(), [])


if __name__ == "__main__":
    harness.main()
