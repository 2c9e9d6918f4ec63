#!/usr/bin/env python3
"""Arms and controllets of a run: state, switches, parameters, goals, streams, stop, load, gripper, events."""

import concurrent.futures
import inspect
import pydoc
import threading
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import PATIENCE, Silent, streaming, unless_silent, until


class TwoArms(unittest.TestCase):
    """One run for all; each test begins with both arms at their Cartesian controllets and leaves nothing stopped."""

    @classmethod
    def setUpClass(cls):
        cls.run_ = mp.run("two_arms")
        cls.left, cls.right = cls.run_.arms["left"], cls.run_.arms["right"]
        cls.law = cls.run_["left_cartesian"]

    @classmethod
    def tearDownClass(cls):
        cls.run_.close()

    def setUp(self):
        self.run_.resume()
        self.run_.switch(["left_cartesian", "right_cartesian"])

    def test_state(self):
        state = self.run_.state()
        self.assertEqual(list(state.arms), ["left", "right"])
        left = state.arms["left"]
        self.assertEqual((left.q_rad.shape, left.q_rad.dtype), ((7,), np.float64))
        # The base of the left arm stands at y = 0.26 m; at its home the hand is in the plane of the base.
        np.testing.assert_allclose(self.left.base.position_m, [0, 0.26, 0])
        self.assertFalse(left.held)
        self.assertEqual(left.controllet, "left_cartesian")
        self.assertEqual(left.errors, ())
        later = self.run_.state()
        self.assertGreaterEqual(later.t_s, state.t_s)

    def test_switch_and_refusal(self):
        self.assertEqual(self.run_.switch("left_joint")["started"], ["left_joint"])
        self.assertEqual(self.run_.active, ["right_cartesian", "left_joint"][::-1])
        self.assertTrue(self.run_["left_joint"].active)
        with self.assertRaises(mp.Refused) as caught:
            self.run_.switch(["dual", "left_joint"])
        self.assertEqual(caught.exception.verdict, "two_owners")
        self.assertIn("both own arm 'left'", caught.exception.reason)
        self.assertEqual(self.run_.active, ["left_joint", "right_cartesian"])  # nothing has changed
        self.run_.switch("dual", only=True)
        self.assertEqual(self.run_.active, ["dual"])
        with self.assertRaises(KeyError) as missing:
            self.run_["nothing"]
        self.assertIn("left_joint", str(missing.exception))

    def test_parameters_are_attributes_with_units_and_bounds(self):
        self.law.translational_stiffness_n_per_m = 350
        np.testing.assert_array_equal(self.law.translational_stiffness_n_per_m, [350, 350, 350])
        self.law.translational_stiffness_n_per_m = [300, 310, 320]
        np.testing.assert_array_equal(self.law.translational_stiffness_n_per_m, [300, 310, 320])
        self.law.damping_ratio = 0.9
        self.assertEqual(self.law.damping_ratio, 0.9)
        self.law.projector = "paper_pseudoinverse"
        self.assertEqual(self.law.projector, "paper_pseudoinverse")
        self.law.projector = "dynamic"
        self.law.acceleration_feedforward = False
        self.assertIs(self.law.acceleration_feedforward, False)
        self.law.acceleration_feedforward = True
        self.assertEqual(self.law.parameters["damping_ratio"], 0.9)
        self.assertEqual(self.run_["left_joint"].stiffness_nm_per_rad.shape, (7,))
        text = pydoc.render_doc(self.law, renderer=pydoc.plaintext)
        self.assertIn("0 to 5000 N/m, 3 numbers, or one for all", text)
        self.assertIn("input pose: pose of 7 numbers in world", text)
        self.assertIn("damping_ratio", dir(self.law))

    def test_parameters_are_checked(self):
        before = self.law.parameters
        with self.assertRaises(mp.Refused) as caught:
            self.law.damping_ratio = 50
        self.assertEqual(caught.exception.verdict, "out_of_bounds")
        self.assertIn("0.1 to 2", caught.exception.reason)
        with self.assertRaisesRegex(AttributeError, "did you mean damping_ratio"):
            self.law.damping_ration = 1
        with self.assertRaisesRegex(AttributeError, "no parameter 'name'"):
            self.law.name = "other"
        with self.assertRaisesRegex(ValueError, "finite"):
            self.law.damping_ratio = float("nan")
        with self.assertRaisesRegex(TypeError, "expected numbers"):
            self.law.damping_ratio = "much"
        with self.assertRaises(mp.Refused):
            self.law.translational_stiffness_n_per_m = [1, 2]
        with self.assertRaises(mp.Refused):
            self.law.set("nothing", 1)
        np.testing.assert_equal(self.law.parameters, before)

    def test_features(self):
        feature = self.law.joint_limits
        self.assertTrue(feature.on)
        feature.range_rad = 0.2
        self.assertEqual(feature.range_rad, 0.2)
        self.assertEqual(self.law.parameters["joint_limits.range_rad"], 0.2)
        feature.switch(False)
        self.assertFalse(self.law.features["joint_limits"])
        self.law.feature("joint_limits")
        self.assertTrue(feature.on)
        with self.assertRaisesRegex(AttributeError, "did you mean range_rad"):
            feature.range_rads = 1
        with self.assertRaises(mp.Refused) as caught:
            self.law.feature("joint_limit")
        self.assertEqual(caught.exception.verdict, "unknown_feature")

    def test_goals_arrive(self):
        start = self.left.state.pose
        goal = self.law.goal("pose", start.moved(z=0.04), duration_s=0.4)
        state = goal.wait(PATIENCE)
        self.assertLess(abs(state.pose.position_m[2] - start.position_m[2] - 0.04), 0.01)
        # The same place in the frame of the arm's base, which stands at y = 0.26 m and is not turned; as a matrix.
        matrix = start.matrix
        matrix[:3, 3] -= self.left.base.position_m
        state = self.law.goal("pose", matrix, frame="left_base", duration_s=0.4).wait(PATIENCE)
        self.assertLess(np.linalg.norm(state.pose.position_m - start.position_m), 0.01)
        self.run_.switch("right_joint")
        q = self.right.state.q_rad
        q[6] += 0.1
        state = self.run_["right_joint"].goal("joints", q, duration_s=0.3).wait(PATIENCE)
        self.assertLess(abs(state.q_rad - q).max(), 0.03)

    def test_goals_that_do_not_arrive(self):
        start = self.left.state.pose
        goal = self.law.goal("pose", start.moved(z=0.1), duration_s=20)
        with self.assertRaisesRegex(mp.Timeout, r"left is .* mm .* away from its goal"):
            goal.wait(0.05)
        self.left.stop()
        until(lambda: self.left.state.held, "hold")
        with self.assertRaisesRegex(mp.Refused, "left_cartesian lost left, which left_hold owns now"):
            goal.wait(PATIENCE)
        with self.assertRaises(mp.Refused) as caught:
            self.law.goal("pose", start.moved(x=3))
        self.assertIn(caught.exception.verdict, ("out_of_bounds", "not_active"))
        with self.assertRaises(mp.Refused) as caught:
            self.law.goal("pos", start)
        self.assertEqual(caught.exception.verdict, "unknown_input")
        with self.assertRaisesRegex(ValueError, "4 x 4"):
            self.law.goal("pose", [1, 2, 3])

    def test_stop_and_resume(self):
        self.left.stop()
        self.assertTrue(self.left.state.stopped)
        until(lambda: self.left.state.held, "hold")
        with self.assertRaises(mp.Refused) as caught:
            self.law.activate()
        self.assertEqual(caught.exception.verdict, "arm_stopped")
        self.assertIn("resume()", caught.exception.next_step)
        self.assertEqual(self.right.state.controllet, "right_cartesian")  # another arm goes on
        self.left.resume()
        self.assertTrue(self.left.state.held)
        self.law.activate()
        self.assertFalse(self.left.state.held)

    @streaming
    def test_a_stream_is_followed_and_its_end_holds(self):
        start, before = self.left.state.pose, self.left.state.interventions
        with unless_silent(), self.law.stream("pose") as stream:
            for k in range(31):
                self.assertTrue(stream.send(start.moved(y=0.03 * k / 30)))
                time.sleep(0.01)
            counts = stream.counts()
            if self.left.state.held:
                raise Silent
            self.assertEqual((counts["received"], counts["lost"], counts["refused"]), (31, 0, 0))
            moved = self.left.state.pose.position_m - start.position_m
        self.assertGreater(moved[1], 0.01)
        state = self.left.state
        self.assertTrue(state.held)
        if state.last_intervention == "reference_stale" and state.interventions > before:
            raise Silent
        # Taken over at once, not after a silence.
        with self.assertRaises(mp.Disconnected):
            stream.send(start)

    def test_silence_holds(self):
        start = self.right.state.pose
        with self.run_["right_cartesian"].stream("pose") as stream:
            stream.send(start)
            until(lambda: self.right.state.held, "hold after silence")
            self.assertEqual(self.right.state.last_intervention, "reference_stale")
            with self.assertRaises(mp.Refused) as caught:  # samples are refused until the controllet is activated
                while True:
                    stream.send(start)
                    time.sleep(0.01)
            self.assertEqual(caught.exception.verdict, "not_active")
            self.run_.switch("right_cartesian")
            stream.send(start)
            until(lambda: stream.counts()["verdict"] == "accepted", "accepted again")

    @streaming
    def test_a_goal_after_a_stream_goes_on(self):
        start = self.left.state.pose
        with unless_silent(), self.law.stream("pose") as stream:
            stream.send(start)
            goal = self.law.goal("pose", start.moved(z=0.02), duration_s=0.3)
        self.assertTrue(self.law.active)
        goal.wait(PATIENCE)

    def test_a_sample_that_is_no_pose_is_not_sent(self):
        with self.law.stream("pose") as stream:
            for wrong in ([1, 2, 3], np.full(7, np.nan)):
                with self.assertRaises(ValueError):
                    stream.send(wrong)
            self.assertEqual(stream.counts()["received"], 0)
        self.assertTrue(self.law.active)  # nothing was commanded

    def test_a_second_client_and_many_threads(self):
        with mp.connect() as other:
            self.assertEqual(other.scene, "two_arms")
            with concurrent.futures.ThreadPoolExecutor(8) as pool:
                states = list(pool.map(lambda client: client.state().cycle, [self.run_, other] * 100))
            self.assertEqual(len(states), 200)
            other["left_cartesian"].damping_ratio = 0.7
            self.assertEqual(self.law.damping_ratio, 0.7)
        self.assertTrue(self.law.active)

    def test_a_client_that_fails_leaves_its_arms_in_hold(self):
        with self.assertRaisesRegex(ValueError, "mine"), mp.connect() as other:
            other["left_cartesian"].goal("pose", self.left.state.pose.moved(z=0.05), duration_s=20)
            raise ValueError("mine")
        until(lambda: self.left.state.held, "hold")
        self.assertFalse(self.right.state.held)  # not that client's
        with mp.connect() as other:
            other.switch("left_joint")
        until(lambda: not self.left.state.held, "an orderly end changes nothing")

    def test_states_and_events(self):
        seen = []

        def watch():
            for event in self.run_.events():
                seen.append(event)
                if {e.kind for e in seen} >= {"controllet", "stopped", "resumed"}:
                    return

        watcher = threading.Thread(target=watch)
        watcher.start()
        deadline = time.monotonic() + PATIENCE
        while watcher.is_alive() and time.monotonic() < deadline:  # begins to watch at some time
            self.law.activate()
            self.left.stop()
            time.sleep(0.03)
            self.left.resume()
            time.sleep(0.03)
        watcher.join(PATIENCE)
        self.assertFalse(watcher.is_alive())
        self.assertEqual({event.arm for event in seen if event.kind in ("controllet", "stopped", "resumed")}, {"left"})
        states = self.run_.states(100)
        cycles = [next(states).cycle for _ in range(5)]
        states.close()
        self.assertEqual(cycles, sorted(cycles))

    def test_the_simulation(self):
        self.run_.place("box", [0.6, 0.05, 0.3])
        with self.assertRaisesRegex(mp.Refused, "box"):
            self.run_.place("boxx", [0.6, 0, 0.3])
        self.run_.pause()
        self.run_.step(5)
        self.run_.pause(False)

    def test_load_and_frames(self):
        self.left.set_load(0.2, [0, 0, 0.05], np.diag([1e-3, 1e-3, 1e-3]))
        with self.assertRaises(mp.Refused):
            self.left.set_load(500, [0, 0, 0])
        with self.assertRaisesRegex(ValueError, "symmetric"):
            self.left.set_load(0.2, [0, 0, 0], [[1, 2, 3]] * 3)
        before = self.left.state.pose
        self.left.set_frames(end_effector=mp.Pose(np.zeros(3), np.array([1.0, 0, 0, 0])))
        moved = lambda: np.linalg.norm(self.left.state.pose.position_m - before.position_m) > 0.05
        until(moved, "the flange is the end effector")
        self.left.set_load(0, [0, 0, 0])

    def test_an_error_is_recovered_on_request_only(self):
        self.right.user_stop(True)
        until(lambda: self.right.state.mode != "move" or self.right.state.errors, "the user stop")
        self.right.user_stop(False)
        self.assertTrue(self.right.state.held)
        with self.assertRaises(mp.Refused):
            self.left.recover()  # it has no error
        for _ in range(3):
            try:
                self.right.recover()
                break
            except mp.Refused:
                pass
        until(lambda: self.right.state.mode == "move" and not self.right.state.errors, "the arm is back")
        self.assertTrue(self.right.state.held)

    def test_stubs(self):
        text = mp.stubs(self.run_)
        compile(text, "stubs", "exec")
        self.assertIn("class LeftCartesian(mp.Controllet):", text)
        self.assertIn('    projector: Literal["dynamic", "paper_pseudoinverse", "damped_pseudoinverse"]', text)
        self.assertIn("0 to 5000 N/m", text)

    def test_a_table(self):
        page = self.run_._repr_html_()
        self.assertIn("<td>left_cartesian</td>", page)


class Gripper(unittest.TestCase):
    def test_moves_and_refuses(self):
        with mp.run("grippers") as run:
            arm = run.arms["left"]
            arm.gripper.homing()
            until(lambda: arm.gripper.state.max_width_m > 0.07, "the range is known")
            arm.gripper.move(0.07)
            until(lambda: abs(arm.gripper.state.width_m - 0.07) < 0.002, "the width")
            with self.assertRaises(mp.Refused):
                arm.gripper.grasp(0.02, force_n=20)  # the box between the fingers is 4 cm wide
            self.assertFalse(arm.gripper.state.grasped)
            arm.gripper.move(0.07)
            arm.gripper.grasp(0.04, force_n=30)
            until(lambda: arm.gripper.state.grasped, "the box is held")
            arm.gripper.stop()
            run.arms["right"].vacuum.on(500)
            until(lambda: run.arms["right"].state.gripper.grasped, "the part is held")
            run.arms["right"].vacuum.drop()

    def test_an_arm_without_one(self):
        with mp.run("one_arm") as run:
            if run.arms["arm"].state.gripper is None:
                with self.assertRaises(mp.Refused):
                    run.arms["arm"].gripper.state  # noqa: B018


class Poses(unittest.TestCase):
    def test_matrix_and_back(self):
        random = np.random.default_rng(3)
        for _ in range(200):
            quaternion = random.normal(size=4)
            quaternion /= np.linalg.norm(quaternion)
            pose = mp.Pose(random.normal(size=3), quaternion)
            # Rodrigues' formula, of angle and axis, gives the rotation another way.
            angle = 2 * np.arctan2(np.linalg.norm(quaternion[1:]), quaternion[0])
            x, y, z = quaternion[1:] / np.linalg.norm(quaternion[1:])
            k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            expected = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
            np.testing.assert_allclose(pose.rotation, expected, atol=1e-12)
            again = mp.Pose.of(pose.matrix)
            np.testing.assert_allclose(again.position_m, pose.position_m)
            self.assertLess(again.angle_to(pose), 1e-6)
        turned = mp.Pose.of([0, 0, 0, np.cos(0.2), 0, 0, np.sin(0.2)])
        self.assertAlmostEqual(turned.angle_to(mp.Pose.of(np.eye(4))), 0.4)


class Surface(unittest.TestCase):
    def test_every_public_name_is_documented(self):
        for name in mp.__all__:
            thing = getattr(mp, name)
            if callable(thing):
                self.assertTrue(inspect.getdoc(thing), name)


if __name__ == "__main__":
    harness.main()
