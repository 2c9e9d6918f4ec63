#!/usr/bin/env python3
"""Arms and controllets of a run: state, switches, parameters, goals, streams, stop, load, gripper, events."""

import asyncio
import concurrent.futures
import contextlib
import inspect
import json
import math
import os
import pydoc
import socket
import subprocess
import sys
import threading
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import multipanda.aio
import numpy as np
from harness import PATIENCE, Silent, streaming, unless_silent, until


class Forwarded:
    """Forwards the clients of a socket to another socket."""

    def __init__(self, path, to):
        self.server, self.copied = socket.socket(socket.AF_UNIX), []
        self.server.bind(str(path))
        self.server.listen()
        threading.Thread(target=self.serve, args=(to,), daemon=True).start()

    def serve(self, to):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self.server.accept()
                far = socket.socket(socket.AF_UNIX)
                self.copied += [near, far]
                far.connect(str(to))
                for a, b in ((near, far), (far, near)):
                    threading.Thread(target=self.copy, args=(a, b), daemon=True).start()

    @staticmethod
    def copy(a, b):
        with contextlib.suppress(OSError):
            while data := a.recv(65536):
                b.sendall(data)
            b.shutdown(socket.SHUT_WR)

    def __enter__(self):
        return self

    def __exit__(self, *left):
        self.server.shutdown(socket.SHUT_RDWR)  # ends accept()
        for one in (self.server, *self.copied):
            one.close()


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

    def test_a_stop_needs_nothing_of_its_client(self):
        other = mp.connect(self.run_.connection.path)
        other.close()
        with self.assertWarnsRegex(UserWarning, "there is no arm 'lefd'.*: all arms are stopped"):
            other.stop("lefd")
        until(
            lambda: all(arm.stopped for arm in self.run_.state().arms.values()), "the state of a cycle after the stop"
        )
        self.assertIn("until resume", self.run_.lost_by("left_joint", self.left.state))

    def test_a_stop_needs_neither_the_folder_nor_the_file_of_its_socket(self):
        path = self.run_.connection.path
        before = os.getcwd()
        os.chdir(path.parent)
        try:
            client = mp.connect(path.name)
            os.chdir("/")
            client.stop("left")
            self.assertTrue(client.arms["left"].state.stopped)
        finally:
            os.chdir(before)
        away = path.with_suffix(".away")
        path.rename(away)
        try:
            client.stop("right")
            self.assertTrue(client.arms["right"].state.stopped)
        finally:
            away.rename(path)
            client.close()

    def test_a_stop_of_asyncio_needs_no_free_thread(self):
        async def stopped():
            asyncio.get_running_loop().set_default_executor(concurrent.futures.ThreadPoolExecutor(1))
            client = await mp.aio.connect(self.run_.connection.path)
            goes_on = threading.Event()
            waiting = asyncio.ensure_future(client.in_thread(goes_on.wait))
            await client.stop()
            goes_on.set()
            await waiting
            await client.close()

        asyncio.run(stopped())
        self.assertEqual([arm.stopped for arm in self.run_.state().arms.values()], [True, True])

    def test_why_an_arm_was_removed_from_its_law_outlasts_clamps(self):
        pose = self.law.stream("pose")
        pose.send(self.left.state.pose)
        until(lambda: self.left.state.held, "the hold after silence")
        until(lambda: self.left.state.removed_by == "reference_stale", "its reason")
        with self.assertRaises(mp.Refused) as refused:
            until(lambda: pose.send(self.left.state.pose) is None, "a refusal")
        self.assertIn("left_hold owns now: reference stale", refused.exception.reason)
        pose.close()

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
        self.assertIn("0.1 to 2, found 50", caught.exception.reason)
        with self.assertRaisesRegex(AttributeError, "did you mean damping_ratio"):
            self.law.damping_ration = 1
        with self.assertRaisesRegex(AttributeError, "no parameter 'name'"):
            self.law.name = "other"
        with self.assertRaisesRegex(AttributeError, "did you mean translational_stiffness_n_per_m or rotational_s"):
            self.law.stiffness  # noqa: B018
        with self.assertRaisesRegex(AttributeError, "left_cartesian has no parameter 'tank'; it has: translational_s"):
            self.law.tank  # noqa: B018
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

    def test_goals_of_a_law_of_two_arms(self):
        self.run_.switch("dual", only=True)
        law, arms = self.run_["dual"], self.run_.arms.values()
        heights = np.array([arm.state.pose.position_m[2] for arm in arms])
        goal = law.goal("common_pose", law.set_point("common_pose").moved(z=0.03), duration_s=2)
        with self.assertRaisesRegex(mp.Timeout, "2.0 s at least"):
            goal.wait(0.01)
        goal.wait(PATIENCE)
        now = [arm.state for arm in arms]
        # Both hands follow one pose, which begins in their middle.
        np.testing.assert_allclose([state.pose.position_m[2] for state in now], heights.mean() + 0.03, atol=0.01)
        self.assertLess(max(abs(state.dq_rad_per_s).max() for state in now), 0.05)
        self.run_.switch(["left_cartesian", "right_cartesian"])

    def test_goals_relative_to_the_set_point(self):
        for _ in range(3):
            goal = self.law.set_point("pose").moved(z=0.02)
            self.law.goal("pose", goal).wait(PATIENCE)
            until(lambda goal=goal: self.law.set_point("pose").is_close(goal, 1e-9, 1e-7), "the set-point is there")
        with self.assertRaises(mp.Refused) as caught:
            self.run_["left_joint"].set_point("joints")
        self.assertEqual(caught.exception.verdict, "not_active")
        self.run_.switch("left_joint")
        state = self.run_["left_joint"].goal("joints", self.left.home_rad).wait(PATIENCE)
        np.testing.assert_allclose(state.q_rad, [0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4], atol=0.03)

    def test_goals_that_do_not_arrive(self):
        start = self.left.state.pose
        goal = self.law.goal("pose", start.moved(z=0.1), duration_s=20)
        with self.assertRaisesRegex(
            mp.Timeout,
            r"left is .* mm .* away from its goal.*longer than requested, within its limits .duration_s: 20.0 s",
        ):
            goal.wait(0.05)
        # Into the table, which is at z = 0.2 m.
        below = mp.Pose([0.6, start.position_m[1], 0.02], start.quaternion_wxyz)
        goal = self.law.goal("pose", below)

        def behind():
            record = self.run_.record()
            return np.linalg.norm(record["left_cartesian/pose"][:3] - record["left/position_m"])

        until(lambda: behind() > 0.08, "contact")
        with self.assertRaisesRegex(
            mp.Timeout, "its set-point .* something is in the way, the goal is beyond its reach or a joint's range"
        ):
            goal.wait(0.05)
        goal = self.law.goal("pose", start.moved(z=0.1), duration_s=20)
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

    def test_a_goal_ends_at_a_contact(self):
        """Onto the table at z = 0.2 m: it rests there, and does not press with the 60 N of the spring."""
        start = self.left.state.pose
        above = mp.Pose([0.6, start.position_m[1], start.position_m[2]], start.quaternion_wxyz)
        self.law.goal("pose", above).wait(PATIENCE)
        goal = self.law.goal("pose", above.moved(z=-0.4), duration_s=8, until={"force_n": 8})
        state = goal.wait(PATIENCE)
        self.assertEqual(goal.ended_by, "force_n")
        self.assertFalse(state.held)
        self.assertLess(abs(state.pose.position_m[2] - 0.215), 0.01)  # the fingers end 1 to 2 cm below the tool center
        self.assertGreater(self.law.set_point("pose").position_m[2], 0.2)  # it was to go to 0.09 m
        self.assertLess(-self.left.state["contact_wrench_n_nm"][2], 15)
        goal = self.law.goal("pose", above, until={"distance_m": 0.02})
        goal.wait(PATIENCE)
        self.assertEqual(goal.ended_by, "distance_m")
        goal = self.law.goal("pose", above, until={"distance_m": 2})
        goal.wait(PATIENCE)
        self.assertEqual(goal.ended_by, "")
        for until_, why in (
            ({}, "is empty; expected force_n or torque_nm or distance_m"),
            ({"force": 8}, "force_n"),
            ({"force_n": -1}, "a number above 0"),
        ):
            with self.assertRaisesRegex(mp.Refused, why):
                self.law.goal("pose", above, until=until_)
        self.law.goal("pose", start).wait(PATIENCE)

    def test_stop_and_resume(self):
        self.left.stop()
        self.assertTrue(self.left.state.stopped)
        until(lambda: self.left.state.held, "hold")
        with self.assertRaises(mp.Refused) as caught:
            self.law.activate()
        self.assertEqual(caught.exception.verdict, "arm_stopped")
        self.assertIn("resume()", caught.exception.next_step)
        self.assertEqual(self.right.state.controllet, "right_cartesian")  # another arm goes on
        seen = self.run_.ask({"do": "state"})["state"]["stops"]
        self.left.stop()  # of a stopped arm: answered at once
        until(lambda: self.run_.ask({"do": "state"})["state"]["stops"] > seen, "the second stop")
        with self.assertRaises(mp.Refused) as caught:
            self.run_.resume("left", seen)
        self.assertEqual(caught.exception.verdict, "arm_stopped")
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
            self.assertRegex(str(caught.exception), "lost right, which right_hold owns now: reference stale")
            self.run_.switch("right_cartesian")
            stream.send(start)
            until(lambda: stream.counts()["verdict"] == "accepted", "accepted again")

    @streaming
    def test_actions_of_a_policy(self):
        start = self.law.set_point("pose")
        actions = [start.moved(y=0.002 * k) for k in range(1, 13)]
        with unless_silent(), self.law.stream("pose") as stream:
            since_s = self.run_.state().t_s + 0.1
            stream.follow(actions, 0.05, since_s)
            until(lambda: self.run_.state().t_s > since_s + 0.52 or self.left.state.held, "the actions")
            if stream.counts()["late_samples"] or self.left.state.held:
                raise Silent
            history = self.run_.history(1)
            at = np.searchsorted(history.t_s, since_s + 0.05 * np.array([6, 8, 10]) - 1e-4)
            way = history["left_cartesian/pose"][at, 1] - start.position_m[1]
            np.testing.assert_allclose(way, [0.012, 0.016, 0.02], atol=1e-3)
            stream.follow(actions[::-1], 0.05)  # from now on
            self.assertEqual(stream.counts()["late_samples"], 0)

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

    def test_a_forwarded_socket(self):
        """As ssh forwards it: bytes only, no descriptors, one socket."""
        path = harness.FOLDER / "forwarded.sock"
        with Forwarded(path, self.run_.connection.path), mp.connect(path) as far:
            arm, law = far.arms["left"], far["left_cartesian"]
            start = arm.state.pose
            law.goal("pose", start.moved(z=0.02), duration_s=0.3).wait(PATIENCE)
            until_ = {"force_n": 10}
            for call in (
                far.record,
                lambda: law.set_point("pose"),
                lambda: law.stream("pose"),
                lambda: law.goal("pose", start, until=until_),
            ):
                with self.assertRaises(mp.Refused) as caught:
                    call()
                self.assertEqual(caught.exception.verdict, "not_local")
            self.assertTrue(law.active)
            self.assertEqual(far.ask({"do": "channels"})["channels"], [])

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
        self.run_.place("box", mp.Pose.at([0.6, 0.05, 0.3], rpy_rad=[0, 0, 0.4]))
        with self.assertRaisesRegex(mp.Refused, "box"):
            self.run_.place("boxx", [0.6, 0, 0.3])
        self.run_.pause()
        self.run_.place("box", mp.Pose.at([0.6, 0.05, 0.5], rpy_rad=[0, 0, 0.4]))
        self.run_.step(5)
        # It has fallen for 5 ms.
        self.assertTrue(
            self.run_.objects()["box"].is_close(mp.Pose.at([0.6, 0.05, 0.5], rpy_rad=[0, 0, 0.4]), 2e-4, 1e-4)
        )
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


class OneArm(unittest.TestCase):
    def test_waypoints(self):
        """Each goal is set while the hand is near the place before it, which the log shows."""
        with mp.run("one_arm", record=harness.FOLDER) as run:
            start = run["cartesian"].set_point("pose")
            places = [start.moved(z=0.08), start.moved(y=0.08, z=0.08), start.moved(y=0.08)]
            state = run["cartesian"].through("pose", places, timeout_s=PATIENCE)
            self.assertTrue(state.pose.is_close(places[-1], 0.01, 0.03))
        log = mp.read_log(run.log)
        goals = [event for event in log.events if event["kind"] == "target_set"]
        np.testing.assert_allclose([goal["values"] for goal in goals], [place.values for place in places])
        poses = log["arm/model/pose_position"]
        for goal, place in zip(goals[1:], places, strict=False):
            at = np.searchsorted(log["arm/model/cycle"], goal["cycle"]) - 1
            self.assertLess(np.linalg.norm(poses[at] - place.position_m), 0.035)

    def test_a_goal_knows_how_long_it_takes(self):
        """As long as the set-point moves in the log: from the goal's cycle until its rate is zero."""
        goals = []
        with mp.run("one_arm", record=harness.FOLDER) as run:
            law, joint = run["cartesian"], run["joint"]

            def moves(law, name, values, bound, duration_s=None):
                goals.append(law.goal(name, values, duration_s=duration_s))
                self.assertEqual(goals[-1].bounded_by, bound)
                goals[-1].wait(PATIENCE)
                rate = f"{law.name}/{name}"
                until(
                    lambda: np.allclose(run.record()[rate], goals[-1].values, rtol=0, atol=1e-12),
                    "the set-point is there",
                )

            start = law.set_point("pose")
            moves(law, "pose", start.moved(z=0.2), "0.25 m/s", 1)  # the scene's own 0.3 m/s are lowered
            moves(law, "pose", start.moved(z=0.1), "duration_s", 2)
            moves(law, "pose", start.moved(z=0.1).turned([0, 0, 1]), "1 rad/s")
            run.switch("joint")
            moves(joint, "joints", joint.set_point("joints") + [0, 0, 0, 0, 0, 0, 0.6], "0.5 rad/s")
        log = mp.read_log(run.log)
        ends = [goal.accepted_at_s for goal in goals[1:]] + [math.inf]
        for goal, end in zip(goals, ends, strict=True):
            topic = f"{goal.controllet.name}/{goal.spec['name']}"
            t, rate = log.t(f"{topic}/rate"), np.abs(log[f"{topic}/rate"]).max(axis=1)
            moving = t[(rate > 1e-9) & (t > goal.accepted_at_s - 1e-4) & (t < end - 1e-4)]
            self.assertAlmostEqual(moving[-1] - moving[0], goal.shortest_s, delta=0.004)

    def test_values_of_the_scene(self):
        settings = {
            "controllets.cartesian.inputs.pose.timeout_s": 0.6,
            "controllets.cartesian.parameters.translational_stiffness_n_per_m": np.array([300, 310, 320.0]),
        }
        with mp.run("one_arm", settings=settings) as run:
            law = run["cartesian"]
            np.testing.assert_array_equal(law.translational_stiffness_n_per_m, [300, 310, 320])
            with law.stream("pose") as stream:
                self.assertEqual(stream.timeout_s, 0.6)
                begin = run.state().t_s
                stream.send(law.set_point("pose"))
                until(lambda: run.arms["arm"].state.held, "hold after silence")
            silent = [e for e in run.history(4)["t_ns"] * 1e-9 if e >= begin]
            self.assertGreater(len(silent), 590)  # cycles until the hold; with the scene's own 0.1 s they are 100
        for key, message in (
            ("controllets.cartesia.inputs", "no 'cartesia'; did you mean 'cartesian'"),
            ("contact_bounds.speed", "there is no 'contact_bounds'"),
            ("arms.arm.modell", "unknown key 'modell'"),
        ):
            with self.assertRaisesRegex(mp.Refused, message):
                mp.run("one_arm", settings={key: 1})


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

    def test_a_motion_ends_with_its_client_unless_it_was_answered(self):
        with mp.run("grippers") as run:
            arm = run.arms["left"]

            def moves_on(width_m, until_m, answered):
                with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
                    client.connect(str(run.connection.path))
                    asked = {"do": "gripper", "arm": "left", "action": "move", "width_m": width_m, "id": 1}
                    client.sendall(json.dumps(asked | {"speed_m_per_s": 0.05}).encode() + b"\n")
                    until(lambda: abs(arm.gripper.state.width_m - until_m) < 0.005, f"{until_m} m")
                    if answered:
                        self.assertTrue(json.loads(client.makefile("rb").readline())["ok"])
                until(lambda: not arm.gripper.state.moving, "it is at rest")
                return abs(arm.gripper.state.width_m - width_m) < 0.002

            arm.gripper.move(0.075)
            self.assertFalse(moves_on(0.045, 0.065, False))
            self.assertTrue(moves_on(0.075, 0.075, True))
            arm.gripper.grasp(0.04, force_n=30)
            client = mp.connect(run.connection.path)
            client.close()
            time.sleep(0.5)
            self.assertTrue(arm.gripper.state.grasped)  # what an answered grasp holds stays held

    def test_it_follows_a_stream_of_widths_and_stays_where_it_is_without_one(self):
        with mp.run("grippers") as run:
            hand = run.arms["left"].gripper
            hand.move(0.07)
            began = now = run.state().t_s
            lags = []
            while now < began + 4:  # a sine of 0.25 Hz between 60 and 80 mm, at about 30 Hz
                width_m = 0.07 + 0.01 * math.sin(math.pi / 2 * (now - began))
                self.assertTrue(hand.follow(width_m, 0.2))
                time.sleep(1 / 30)
                state = run.state()
                lags.append(abs(state.arms["left"].gripper.width_m - width_m))
                now = state.t_s
            self.assertLess(np.median(lags), 4e-3)  # fingers at rest would be 7 mm away
            with self.assertRaisesRegex(ValueError, "finite"):
                hand.follow(math.nan)
            until(lambda: hand.follow(0.5) and hand.state.width_m > 0.0795, "the end of the range")
            silent = run.state().t_s
            until(lambda: run.state().t_s > silent + 0.3, "silence")
            with mp.connect(run.connection.path) as other:
                second = other.arms["left"].gripper

                def closing(then=lambda: None):
                    second.follow(0.045, 0.01, silence_s=1)
                    then()
                    return hand.state.width_m < 0.078

                until(closing, "the second client's width")
                with self.assertRaisesRegex(mp.Refused, "another client"):
                    until(lambda: closing(lambda: hand.follow(0.08)) and False, "the refusal")
            # It was closed: the fingers stay.
            until(lambda: not hand.state.moving, "rest")
            self.assertGreater(hand.state.width_m, 0.05)

            def follows():
                hand.follow(0.045, 0.01, silence_s=1)
                return hand.state.moving

            until(follows, "following")
            run.stop()
            until(lambda: not hand.state.moving, "rest")
            self.assertGreater(hand.state.width_m, 0.05)
            with self.assertRaisesRegex(mp.Refused, "stopped"):
                until(follows, "the refusal")
            run.resume()
            with self.assertRaisesRegex(mp.Refused, "paused"):  # the same stream
                until(follows, "the refusal")
            resumed = time.monotonic()
            until(lambda: time.monotonic() > resumed + 1.2, "the stream's silence")
            until(follows, "following again")
            hand.hold()

    def test_a_stop_ends_a_motion_and_none_begins_until_the_arm_is_resumed(self):
        with mp.run("grippers") as run:
            arm = run.arms["left"]
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
                client.connect(str(run.connection.path))
                asked = {"do": "gripper", "arm": "left", "action": "move", "width_m": 0.045, "id": 1}
                client.sendall(json.dumps(asked | {"speed_m_per_s": 0.01}).encode() + b"\n")
                until(lambda: arm.gripper.state.width_m < 0.075, "it closes")
                run.stop()
                self.assertFalse(json.loads(client.makefile("rb").readline())["ok"])
            until(lambda: not arm.gripper.state.moving, "it is at rest")
            width_m = arm.gripper.state.width_m
            self.assertGreater(width_m, 0.05)
            for action in (arm.gripper.homing, lambda: arm.gripper.move(0.07), lambda: arm.gripper.grasp(0.04, 20)):
                with self.assertRaisesRegex(mp.Refused, "stopped, and so is its gripper"):
                    action()
            self.assertAlmostEqual(arm.gripper.state.width_m, width_m, delta=2e-4)
            arm.gripper.stop()  # of what it may hold
            run.resume()
            arm.gripper.move(0.07)

    def test_the_arms_button_stops_its_gripper_too(self):
        with mp.run("grippers") as run, mp.connect(run.connection.path) as other:
            arm = run.arms["left"]
            closing = threading.Thread(target=lambda: self.assertRaises(mp.Refused, arm.gripper.move, 0.03, 0.01))
            closing.start()
            until(lambda: arm.gripper.state.width_m < 0.075, "it closes")
            other.arms["left"].user_stop(True)
            closing.join(60)
            until(lambda: not arm.gripper.state.moving, "it is at rest")
            self.assertGreater(arm.gripper.state.width_m, 0.05)
            with self.assertRaisesRegex(mp.Refused, "stopped by its button, and so is its gripper"):
                arm.gripper.grasp(0.04, 20)
            arm.user_stop(False)
            arm.gripper.move(0.07)

    def test_an_arm_without_one(self):
        with mp.run("one_arm") as run:
            if run.arms["arm"].state.gripper is None:
                with self.assertRaises(mp.Refused):
                    run.arms["arm"].gripper.state  # noqa: B018


class Surface(unittest.TestCase):
    def test_every_public_name_is_documented(self):
        for name in mp.__all__:
            thing = getattr(mp, name)
            if callable(thing):
                self.assertTrue(inspect.getdoc(thing), name)

    def test_what_takes_time_to_load_waits_for_the_first_use(self):
        code = "import sys, multipanda as mp; print('numpy' in sys.modules, mp.Pose.__name__, 'numpy' in sys.modules)"
        self.assertEqual(subprocess.check_output([sys.executable, "-c", code], text=True), "False Pose True\n")

    def test_functions_keep_their_names_beside_modules_of_the_same_names(self):
        code = "import multipanda.started, multipanda as mp; print(callable(mp.law), callable(mp.study))"
        self.assertEqual(subprocess.check_output([sys.executable, "-c", code], text=True), "True True\n")


if __name__ == "__main__":
    harness.main()
