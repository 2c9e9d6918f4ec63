#!/usr/bin/env python3
"""Arms of the real program as LeRobot's robots and leaders see them. Needs no LeRobot: where it is missing, the two
packages are tested on the structure of its base classes."""

import contextlib
import importlib.util
import math
import os
import signal
import subprocess
import sys
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import PATIENCE, ROOT, until
from lerobot_scenes import TIMEOUT_S, edited, two_arms
from multipanda.lerobot import (
    ArmsLeader,
    ArmsRobot,
    LeaderSettings,
    RobotSettings,
    SpaceMouseLeader,
    SpaceMouseSettings as MouseSettings,
)
from multipanda.lerobot.names import SteadySigns, quantity_names
from space_mouse_device import Device

FRAME_MS = 33  # 30 Hz
BOTH = ["left", "right"]
ALL_ACTIVE = "active: [left_lead, right_lead, left_follow, right_follow]"
FOLLOWERS = (
    "  # The left pair again",
    "  - {name: left_joint, type: joint_impedance, arms: left, inputs: {joints: {timeout_s: 1}}}\n"
    "  - {name: right_pose, type: cartesian_impedance, arms: right, inputs: {pose: {timeout_s: 1}}}\n"
    "  # The left pair again",
)


@contextlib.contextmanager
def joined(scene, **settings):
    """A run, and a robot that has attached to it."""
    with mp.run(scene) as run:
        robot = ArmsRobot(RobotSettings(socket=str(run.connection.path), **settings))
        robot.connect()
        try:
            yield run, robot
        finally:
            robot.disconnect()


@contextlib.contextmanager
def paused(run):
    """The world moves only by step(); requests to the loop are answered when it goes on."""
    run.pause()
    try:
        yield
    finally:
        run.pause(False)


def now(run):
    """The run, once its newest cycle began after this call: the robot is another client of it."""
    begin_ns = time.monotonic_ns()
    until(lambda: run.record().start_ns > begin_ns, "the next cycle")
    return run


def held(run, arms=BOTH):
    return all(now(run).arms[arm].state.held for arm in arms)


def measured(run, robot):
    """An action that leaves the arms where they are, without the robot's own way to it."""
    found = {}
    for arm in robot.settings.arms:
        state = run.arms[arm].state
        if robot.settings.action == "joints":
            found |= {f"{arm}_joint{k + 1}.pos": q for k, q in enumerate(state.q_rad)}
        else:
            pose = mp.Pose.of(np.linalg.inv(run.arms[arm].base.matrix) @ state.pose.matrix)
            found |= dict(zip(quantity_names(arm, "pose"), pose.values))
    return found


def moved(action, **by):
    return action | {name.replace("__", "."): action[name.replace("__", ".")] + d for name, d in by.items()}


class Features(unittest.TestCase):
    def test_they_are_known_without_a_run(self):
        for arms in (["arm"], BOTH, ["a", "b", "c"]):
            robot = ArmsRobot(RobotSettings(arms=arms, observe=["joints", "wrench"], grippers=arms[-1:]))
            expected = [f"{arm}_joint{k}.pos" for arm in arms for k in range(1, 8)] + [f"{arms[-1]}_gripper.pos"]
            self.assertEqual(robot.action_names, expected)
            self.assertEqual(len(robot.state_names), (7 + 6) * len(arms) + 1)
            self.assertFalse(robot.connected)
            leader = ArmsLeader(
                LeaderSettings(leaders=[f"{arm}_leader" for arm in arms], arms=arms, grippers=arms[-1:])
            )
            self.assertEqual(leader.action_names, expected)
        pose = ["arm_ee.x", "arm_ee.y", "arm_ee.z", "arm_ee.qw", "arm_ee.qx", "arm_ee.qy", "arm_ee.qz"]
        self.assertEqual(ArmsRobot(RobotSettings(action="pose")).action_names, pose)
        self.assertEqual(SpaceMouseLeader(MouseSettings()).action_names, pose)
        self.assertEqual(
            ArmsRobot(RobotSettings(joints=2, observe=["velocities", "torques"])).state_names,
            ["arm_joint1.vel", "arm_joint2.vel", "arm_joint1.torque", "arm_joint2.torque"],
        )

    def test_settings_that_contradict_each_other_are_refused(self):
        for kind, wrong, expected in (
            (RobotSettings, {"arms": []}, "one name or more"),
            (RobotSettings, {"arms": ["a", "a"]}, "each once"),
            (RobotSettings, {"action": "twist"}, "joints, pose"),
            (RobotSettings, {"observe": ["force"]}, "wrench"),
            (RobotSettings, {"grippers": ["left"]}, "not among the arms arm"),
            (RobotSettings, {"controllets": {"left": "x"}}, "not among"),
            (RobotSettings, {"max_jump_rad": 4.0}, "at most 3.14"),
            (RobotSettings, {"max_jump_m": math.nan}, "max_jump_m"),
            (RobotSettings, {"scene": "a", "socket": "b"}, "found both"),
            (RobotSettings, {"addresses": {"arm": "127.0.0.1"}}, "need a scene"),
            (LeaderSettings, {"leaders": ["a"], "arms": ["b", "c"]}, "one for each of 1 leaders"),
            (LeaderSettings, {"leaders": ["a"], "arms": ["b"], "guides": {"b": ""}}, "not among the arms a"),
            (MouseSettings, {"arms": ["a", "b"]}, "one for each"),
            (MouseSettings, {"scene": "one_arm"}, "the robot's run"),
            (MouseSettings, {"gripper_button": 1}, "3 to 32"),
        ):
            with self.subTest(wrong), self.assertRaisesRegex(ValueError, expected):
                kind(**wrong).check()

    def test_signs_of_quaternions_are_steady(self):
        draw = np.random.default_rng(5)
        signs, turned, last = SteadySigns(), np.array([0.02, 1.0, 0.01, 0.0]), None
        for _ in range(400):  # fingers down: w is near zero and changes its sign all the time
            turned = turned + 0.05 * draw.normal(size=4)
            turned /= np.linalg.norm(turned)
            given = turned * draw.choice([-1, 1])
            steady = signs.of("arm", np.concatenate([np.ones(3), given]))
            np.testing.assert_allclose(np.outer(steady[3:], steady[3:]), np.outer(given, given), atol=1e-15)
            if last is None:
                self.assertGreater(steady[3:][np.argmax(np.abs(given))], 0)
            else:
                self.assertGreater(steady[3:] @ last, 0)
            last = steady[3:]


class TwoArms(unittest.TestCase):
    def test_connecting_moves_nothing_and_observes_what_the_arms_measure(self):
        quantities = ["joints", "velocities", "torques", "pose"]
        with joined(two_arms(), arms=["right", "left"], observe=quantities) as (run, robot):
            self.assertTrue(held(run))
            with paused(run):
                run.step(2)
                stood = run.state().t_s
                until(lambda: robot.client.state().t_s >= stood and run.state().t_s >= stood, "the last cycle")
                seen = robot.observe()
                self.assertEqual(list(seen), robot.state_names)
                for arm in BOTH:
                    state = run.arms[arm].state
                    for name, values in (("pos", state.q_rad), ("vel", state.dq_rad_per_s), ("torque", state.tau_J_nm)):
                        found = [seen[f"{arm}_joint{k}.{name}"] for k in range(1, 8)]
                        np.testing.assert_allclose(found, values, rtol=0, atol=1e-12)  # another cycle of an arm at rest
                    pose = mp.Pose.of(np.array([seen[name] for name in quantity_names(arm, "pose")]))
                    in_world = run.arms[arm].base.matrix @ pose.matrix
                    np.testing.assert_allclose(in_world, state.pose.matrix, atol=1e-12)
            self.assertTrue(held(run))
            with self.assertRaisesRegex(mp.Refused, "connected already"):
                robot.connect()
        self.assertRaises(mp.Disconnected, robot.observe)
        self.assertRaises(mp.Disconnected, robot.act, {})

    def test_actions_are_followed_within_the_limits_of_the_engine(self):
        for action in ("joints", "pose"):
            with self.subTest(action), joined(two_arms(), arms=BOTH, action=action, observe=[action]) as (run, robot):
                start = measured(run, robot)
                change = {"left_joint4__pos": 0.25, "right_joint6__pos": -0.25}
                if action == "pose":
                    change = {"left_ee__x": -0.08, "right_ee__z": 0.08}
                goal = moved(start, **change)
                robot.act(start)
                law, last = ("left_joint/joints", 7) if action == "joints" else ("left_cartesian/pose", 3)
                set_points = []
                with run.records() as records, paused(run):
                    for _ in range(60):
                        sent = robot.act(goal)
                        run.step(FRAME_MS)
                        reached = run.state().cycle
                        for record in records:
                            set_points.append(record[law][:last])
                            if record.cycle >= reached:
                                break
                    self.assertEqual(records.lost, 0)
                    for name, value in goal.items():
                        self.assertAlmostEqual(sent[name], value, 12)
                        found = robot.observe()[name]
                        if "_ee.q" in name:  # a quaternion, of either sign
                            found, value = abs(found), abs(value)
                        self.assertAlmostEqual(found, value, delta=4e-3, msg=name)
                    self.assertEqual(robot.silences, 0)
                steps = np.linalg.norm(np.diff(set_points, axis=0), axis=1)
                steps = steps[np.isfinite(steps)]
                # One jump of the action is a motion: at most 2.2 rad/s or 0.6 m/s, never a step.
                self.assertGreater(max(steps), 1e-5)
                self.assertLess(max(steps), 2.2e-3 if action == "joints" else 0.6e-3)
                robot.disconnect()
                self.assertTrue(held(run))

    def test_what_is_refused_holds_both_arms_and_says_why(self):
        with joined(two_arms(), arms=BOTH) as (run, robot):
            good = measured(run, robot)
            bad = (
                ({k: v for k, v in good.items() if k != "left_joint3.pos"}, ValueError, "missing left_joint3.pos"),
                (good | {"top_joint1.pos": 0.0}, ValueError, "unknown top_joint1.pos"),
                (good | {"right_joint7.pos": math.nan}, ValueError, "found nan as right_joint7.pos"),
                (good | {"right_joint7.pos": math.inf}, ValueError, "found inf as right_joint7.pos"),
                (moved(good, right_joint2__pos=0.31), mp.Refused, "joint 2 of 'right' is at .* at most 0.3 rad"),
                (moved(good, left_joint5__pos=-0.31), mp.Refused, "joint 5 of 'left'"),
            )
            for action, error, expected in bad:
                with self.subTest(expected):
                    robot.act(good)
                    self.assertFalse(held(run, ["left"]) or held(run, ["right"]))
                    with self.assertRaisesRegex(error, expected):
                        robot.act(action)
                    self.assertTrue(held(run))
            robot.act(moved(good, right_joint2__pos=0.29))

    def test_poses_that_are_far_away_or_no_rotation_are_refused(self):
        with joined(two_arms(), arms=BOTH, action="pose") as (run, robot):
            good = measured(run, robot)
            turn = np.array([math.cos(0.26), 0, 0, math.sin(0.26)])  # 0.52 rad about the base's z
            q = np.array([good[f"right_ee.{part}"] for part in ("qw", "qx", "qy", "qz")])
            turned = np.array(
                [turn[0] * q[0] - turn[3] * q[3], turn[0] * q[1] - turn[3] * q[2],
                 turn[0] * q[2] + turn[3] * q[1], turn[0] * q[3] + turn[3] * q[0]]
            )  # fmt: skip
            far = good | dict(zip((f"right_ee.{part}" for part in ("qw", "qx", "qy", "qz")), turned))
            for action, error, expected in (
                (moved(good, left_ee__y=0.11), mp.Refused, "'left' is 0.110 m away"),
                (far, mp.Refused, "'right' is turned by 0.520 rad"),
                (good | {"left_ee.qx": 0.0, "left_ee.qy": 0.0}, ValueError, "quaternion of length 1 for 'left'"),
            ):
                with self.subTest(expected):
                    robot.act(good)
                    with self.assertRaisesRegex(error, expected):
                        robot.act(action)
                    self.assertTrue(held(run))
            robot.act({name: -value if "_ee.q" in name else value for name, value in good.items()})  # the same pose

    def test_a_stop_is_obeyed_until_it_is_resumed(self):
        with joined(two_arms(), arms=BOTH) as (run, robot):
            good = measured(run, robot)
            robot.act(good)
            run.stop("right")
            now(robot.client)
            for _ in range(2):
                with self.assertRaisesRegex(mp.Refused, "'right' is stopped"):
                    robot.act(good)
                self.assertTrue(held(run))
            run.resume()
            now(robot.client)
            robot.act(good)
            self.assertFalse(held(run, ["left"]) or held(run, ["right"]))

    def test_silence_holds_and_the_next_action_begins_again(self):
        with joined(two_arms(), arms=BOTH) as (run, robot):
            for silences in range(3):
                robot.act(measured(run, robot))
                self.assertEqual(robot.silences, 2 * silences)
                self.assertFalse(held(run, ["left"]))
                run.pause()
                run.step(round(1e3 * TIMEOUT_S) + 50)
                run.pause(False)
                self.assertTrue(held(run))
                now(robot.client)
                self.assertEqual(run.arms["left"].state.last_intervention, "reference_stale")

    def test_arms_that_somebody_else_has_taken_are_not_taken_back(self):
        with joined(two_arms(), arms=BOTH) as (run, robot):
            good = measured(run, robot)
            robot.act(good)
            run.switch("right_cartesian")
            now(robot.client)
            with self.assertRaisesRegex(mp.Refused, "right_joint lost 'right', which right_cartesian owns now"):
                robot.act(good)
            self.assertEqual(now(run).arms["right"].state.controllet, "right_cartesian")
            self.assertTrue(held(run, ["left"]))
            with self.assertRaisesRegex(mp.Refused, "'right' is owned by right_cartesian"):
                robot.act(good)
            run.switch(deactivate="right_cartesian")
            now(robot.client)
            robot.act(good)
            run.switch(deactivate="left_joint")
            now(robot.client)
            # After a silence it would begin again; this was somebody's decision.
            with self.assertRaisesRegex(mp.Refused, "left_joint lost 'left', which left_hold owns now"):
                robot.act(good)

    def test_a_controllet_that_somebody_else_streams_to_is_left_alone(self):
        with joined(two_arms("left_joint"), arms=BOTH) as (run, robot):
            good = measured(run, robot)
            with run["left_joint"].stream("joints") as other:
                other.send(run.arms["left"].state.q_rad)
                with self.assertRaisesRegex(mp.Refused, "another client streams to left_joint of 'left'"):
                    robot.act(good)
                self.assertTrue(held(run, ["right"]))
                other.send(run.arms["left"].state.q_rad)
            now(robot.client)
            robot.act(good)

    def test_an_arm_in_user_stop_is_not_moved(self):
        with joined(two_arms(), arms=BOTH) as (run, robot):
            good = measured(run, robot)
            robot.act(good)
            run.arms["left"].user_stop(True)
            until(lambda: run.arms["left"].state.mode == "user_stopped", "the stop button")
            now(robot.client)
            with self.assertRaises(mp.Refused):
                robot.act(good)
            self.assertTrue(held(run))
            with self.assertRaises(mp.Refused):
                robot.act(good)

    def test_which_controllet_follows(self):
        path = str(two_arms())
        for settings, expected in (
            ({"arms": ["middle"]}, "no arm 'middle'; it has: left, right"),
            ({"arms": ["left"], "joints": 6}, "7 joints, expected 6"),
            ({"arms": ["left"], "controllets": {"left": "left_cartesian"}}, "'left_cartesian' does not own"),
            ({"arms": ["left"], "controllets": {"left": "coupled"}, "action": "pose"}, "'coupled' does not own"),
            ({"arms": ["left"], "grippers": ["left"]}, "'left' has no gripper"),
        ):
            with self.subTest(expected):
                robot = ArmsRobot(RobotSettings(scene=path, **settings))
                with self.assertRaisesRegex(mp.Refused, expected):
                    robot.connect()
                self.assertFalse(robot.connected)
        self.assertEqual(harness.sockets(), [])


class Ends(unittest.TestCase):
    def test_a_run_of_its_own_ends_in_hold(self):
        robot = ArmsRobot(RobotSettings(scene=str(two_arms("left_cartesian")), arms=BOTH))
        robot.connect()
        run = robot.client
        self.assertEqual(run.arms["left"].state.controllet, "left_cartesian")
        robot.act(measured(run, robot))  # nobody else is there: the arm is taken over
        self.assertEqual(run.arms["left"].state.controllet, "left_joint")
        robot.disconnect()
        robot.disconnect()
        self.assertFalse(run.running)
        self.assertEqual(run.process.child.poll(), 0)
        self.assertEqual(harness.sockets(), [])

    def test_a_program_that_dies_is_said_and_can_be_disconnected(self):
        robot = ArmsRobot(RobotSettings(scene=str(two_arms()), arms=BOTH))
        robot.connect()
        good = measured(robot.client, robot)
        robot.act(good)
        robot.client.process.child.kill()
        robot.client.process.child.wait(PATIENCE)
        until(lambda: self.raises(robot, good), "the end of the run is noticed")
        with self.assertLogs("multipanda.lerobot", "ERROR"):
            robot.disconnect()
        self.assertFalse(robot.connected)

    def raises(self, robot, good):
        try:
            robot.act(good)
        except mp.Error:
            return True
        return False

    def test_killed_in_mid_motion_the_arms_are_held(self):
        program = (
            "import sys, time, multipanda.lerobot as ml\n"
            "robot = ml.ArmsRobot(ml.RobotSettings(socket=sys.argv[1], arms=['left', 'right']))\n"
            "robot.connect()\n"
            "action = robot.observe()\n"
            "for k in range(10**6):\n"
            "    robot.act(action | {'left_joint1.pos': action['left_joint1.pos'] + min(0.2, 0.01 * k)})\n"
            "    print(k, flush=True)\n"
            "    time.sleep(0.02)\n"
        )
        with mp.run(two_arms()) as run:
            child = subprocess.Popen(
                [sys.executable, "-c", program, str(run.connection.path)], stdout=subprocess.PIPE, text=True
            )
            for _ in range(10):
                self.assertTrue(child.stdout.readline())
            os.kill(child.pid, signal.SIGKILL)
            child.communicate(timeout=PATIENCE)
            until(lambda: held(run), "hold")
            until(lambda: np.max(np.abs(run.arms["left"].state.dq_rad_per_s)) < 1e-3, "rest")
            before = run.arms["left"].state.q_rad
            start = run.state().t_s
            until(lambda: run.state().t_s > start + 0.5, "half a second")
            np.testing.assert_allclose(run.arms["left"].state.q_rad, before, atol=1e-3)


class Fingers(unittest.TestCase):
    def test_widths_are_reached_and_small_ones_grasp(self):
        scene = edited("grippers", "grippers_lerobot", ("active: [left_pose, right_pose]", ""))
        settings = {"arms": ["left"], "action": "pose", "observe": ["pose"], "grippers": ["left"]}
        with joined(scene, **settings) as (run, robot):
            hand = robot.observe()
            self.assertEqual(list(hand), robot.state_names)

            def to(width, reached):
                def there():
                    robot.act(hand | {"left_gripper.pos": width})
                    return reached(run.arms["left"].state.gripper)

                until(there, f"fingers at {width}")

            to(0.06, lambda fingers: abs(fingers.width_m - 0.06) < 1e-3)
            self.assertAlmostEqual(robot.observe()["left_gripper.pos"], 0.06, delta=1e-3)
            to(0.0, lambda fingers: fingers.grasped)  # the box between them is 0.04 m wide
            self.assertAlmostEqual(robot.observe()["left_gripper.pos"], 0.04, delta=2e-3)
            with self.assertRaisesRegex(ValueError, "at most 0.2 m for the fingers of 'left'"):
                robot.act(hand | {"left_gripper.pos": 0.3})
            self.assertTrue(held(run, ["left"]))
            to(0.15, lambda fingers: fingers.width_m > 0.079 and not fingers.grasped)  # wider than this hand opens
            to(0.0, lambda fingers: fingers.grasped)
            robot.disconnect()
            self.assertTrue(run.arms["left"].state.gripper.grasped)


class FingersOfAHeldRobot(unittest.TestCase):
    def test_they_stay_where_they_are_and_begin_again(self):
        scene = edited("grippers", "grippers_held", ("active: [left_pose, right_pose]", ""))
        settings = {"arms": ["left"], "action": "pose", "observe": ["pose"], "grippers": ["left"]}
        with joined(scene, **settings) as (run, robot):
            hand = robot.observe()

            def closes():
                robot.act(hand | {"left_gripper.pos": 0.0})
                return run.arms["left"].state.gripper.width_m < 0.07

            until(closes, "closing fingers")
            robot.hold()
            start = run.state().t_s
            until(lambda: run.state().t_s > start + 0.5, "half a second")
            self.assertGreater(run.arms["left"].state.gripper.width_m, 0.045)  # the box is 40 mm wide
            self.assertFalse(run.arms["left"].state.gripper.moving)
            until(lambda: closes() and run.arms["left"].state.gripper.grasped, "a grasp of the box")


class Leaders(unittest.TestCase):
    def test_a_leader_that_a_program_moves_leads_the_other_pair(self):
        scene = edited("leaders_and_followers", "led", (ALL_ACTIVE, "active: [left_lead, right_lead]"), FOLLOWERS)
        with mp.run(scene) as run:
            socket = str(run.connection.path)
            leader = ArmsLeader(
                LeaderSettings(socket=socket, leaders=["left_leader"], arms=["left"], guides={"left_leader": ""})
            )
            leader.connect()
            robot = ArmsRobot(RobotSettings(socket=socket, arms=["left"]))
            robot.connect()
            self.assertEqual(leader.action_names, robot.action_names)
            goal = run.arms["left_leader"].state.q_rad + np.array([0.3, 0.1, 0, 0.1, 0, 0, 0.2])
            run["left_lead"].goal("joints", goal, duration_s=1.5)
            robot.act(leader.read())
            with paused(run):
                for _ in range(90):
                    robot.act(leader.read())
                    run.step(FRAME_MS)
                np.testing.assert_allclose(run.arms["left"].state.q_rad, goal, atol=0.02)
                self.assertEqual(robot.silences, 0)
            # Poses are those of each arm's own base: the right pair's bases are turned against each other.
            hands = ArmsLeader(
                LeaderSettings(
                    socket=socket, leaders=["right_leader"], arms=["right"], action="pose", guides={"right_leader": ""}
                )
            )
            hands.connect()
            with paused(run):
                read = np.array(list(hands.read().values()))
                arm = run.arms["right_leader"]
                expected = np.linalg.inv(arm.base.matrix) @ arm.state.pose.matrix
                np.testing.assert_allclose(mp.Pose.of(read).matrix, expected, atol=1e-12)
            for device in (hands, leader, robot):
                device.disconnect()

    def test_the_scene_of_the_guide(self):
        text = (ROOT / "docs/lerobot.md").read_text(encoding="utf-8").partition("```yaml\n")[2].partition("```")[0]
        path = harness.FOLDER / "my_pair.yaml"
        path.write_text(text, encoding="utf-8")
        with mp.run(path) as run:
            self.assertTrue(held(run, ["leader", "follower"]))
            leader = ArmsLeader(LeaderSettings(socket=str(run.connection.path), leaders=["leader"], arms=["follower"]))
            robot = ArmsRobot(RobotSettings(socket=str(run.connection.path), arms=["follower"]))
            leader.connect()
            robot.connect()

            def led():
                robot.act(leader.read())
                owners = {name: state.controllet for name, state in now(run).state().arms.items()}
                return owners == {"leader": "guide", "follower": "joint"}

            until(led, "both are led")  # the follower's 0.2 s may pass on a busy computer
            robot.disconnect()
            leader.disconnect()
            self.assertTrue(held(run, ["leader", "follower"]))

    def test_a_leader_is_soft_while_it_is_connected_and_held_afterwards(self):
        with mp.run(edited("leaders_and_followers", "soft", (ALL_ACTIVE, "active: [right_lead]"))) as run:
            socket = str(run.connection.path)
            for settings, expected in (
                ({"leaders": ["left_leader", "right_leader"]}, "'right_leader' is owned by right_lead"),
                ({"leaders": ["left"]}, "no gravity_compensation of 'left'"),
                (
                    {"leaders": ["left_leader"], "guides": {"left_leader": "left_both"}},
                    "'left_both' is not a controllet",
                ),
            ):
                with self.assertRaisesRegex(mp.Refused, expected):
                    ArmsLeader(LeaderSettings(socket=socket, **settings)).connect()
                self.assertTrue(held(run, ["left_leader"]))
            self.assertEqual(run.arms["right_leader"].state.controllet, "right_lead")
            leader = ArmsLeader(LeaderSettings(socket=socket, leaders=["left_leader"], arms=["left"]))
            leader.connect()
            until(lambda: run.arms["left_leader"].state.controllet == "left_guide", "it is soft")
            self.assertEqual(list(leader.read()), leader.action_names)
            run.stop("left_leader")
            now(leader.client)
            with self.assertRaisesRegex(mp.Refused, "'left_leader' is owned by left_leader_hold: it is stopped"):
                leader.read()
            leader.disconnect()
            run.resume()
            leader.connect()
            until(lambda: not run.arms["left_leader"].state.held, "it is soft")
            leader.disconnect()
            until(lambda: run.arms["left_leader"].state.held, "it is held")

    def test_a_space_mouse_leads_while_its_button_is_held(self):
        device = Device()
        with joined(two_arms(), arms=["left"], action="pose", observe=["pose"]) as (run, robot):
            mouse = SpaceMouseLeader(
                MouseSettings(socket=str(run.connection.path), arms=["left"], devices={"left": device.path})
            )
            mouse.connect()
            start = run.arms["left"].state.pose.position_m
            try:
                device.push(0, 0, -350, 0, 0, 0)  # up

                def rise():
                    robot.act(mouse.read())
                    return run.arms["left"].state.pose.position_m[2] - start[2]

                until(lambda: robot.act(mouse.read()) and run.state().t_s > 0.5, "half a second")
                self.assertLess(rise(), 2e-3)  # nobody holds the button
                device.press(1)
                until(lambda: rise() > 0.03, "the hand rises")
                led = mouse._mice["left"]

                def ahead():
                    """How far the target is above the hand [m]."""
                    robot.act(mouse.read())
                    return led.target.position_m[2] - run.arms["left"].state.pose.position_m[2]

                until(lambda: ahead() > 4e-3, "the target leads the hand")
                device.press(0)
                until(lambda: ahead() is not None and not led.grip.held, "the button is let go")
                self.assertLess(led.target.position_m[2] - run.arms["left"].state.pose.position_m[2], 2e-3)
                let_go = rise()
                device.let_cap_go()
                until(lambda: rise() is not None and np.max(np.abs(run.arms["left"].state.dq_rad_per_s)) < 5e-3, "rest")
                self.assertLess(rise() - let_go, 0.02)
                side = np.linalg.norm((run.arms["left"].state.pose.position_m - start)[:2])
                self.assertLess(side, 5e-3)
                device.press(2)
                with self.assertRaisesRegex(mp.Refused, "'left' is stopped"):
                    until(lambda: rise() is None, "the stop")
                self.assertTrue(run.arms["left"].state.stopped)
                device.unplug()
                with self.assertRaises(mp.Disconnected):
                    until(lambda: mouse.read() is None, "the device is gone")
            finally:
                mouse.disconnect()
                device.close()


class Packages(unittest.TestCase):
    """The two packages, on LeRobot's classes or their structure."""

    @classmethod
    def setUpClass(cls):
        import lerobot_packages

        cls.packages = lerobot_packages
        if not lerobot_packages.INSTALLED:
            print("LeRobot is not installed: the packages are tested on the structure of its classes")

    def config(self, folder, **settings):
        return self.packages.robot_package.MultipandaConfig(id="test", calibration_dir=folder, **settings)

    def test_a_robot_of_two_arms(self):
        config = self.config(harness.FOLDER, scene=str(two_arms()), arms=BOTH, observe=["joints", "pose"])
        self.assertEqual(config.type, "multipanda")
        robot = self.packages.robot_package.Multipanda(config)
        self.assertEqual(len(robot.action_features), 14)
        self.assertEqual(len(robot.observation_features), 28)
        self.assertEqual(set(robot.action_features.values()), {float})
        with self.assertRaisesRegex(ConnectionError, "not connected"):
            robot.get_observation()
        with robot:
            seen = robot.get_observation()
            self.assertEqual(list(seen), list(robot.observation_features))
            sent = robot.send_action({name: seen[name] for name in robot.action_features})
            self.assertEqual(list(sent), list(robot.action_features))
            with self.assertRaisesRegex(ConnectionError, "already"):
                robot.connect()
            process = robot.arms.client.process
        self.assertFalse(robot.is_connected)
        self.assertEqual(process.child.poll(), 0)

    def test_wrong_settings_are_refused_when_the_configuration_is_made(self):
        with self.assertRaisesRegex(ValueError, "each once"):
            self.config(harness.FOLDER, arms=["a", "a"])
        with self.assertRaisesRegex(ValueError, "joints, pose"):
            self.packages.teleoperator_package.MultipandaLeaderConfig(action="x")

    def test_cameras_are_part_of_the_observation(self):
        if self.packages.INSTALLED:
            self.skipTest("LeRobot's own cameras need devices")
        from lerobot.cameras import CameraConfig

        cameras = {"top": CameraConfig(height=4, width=6)}
        config = self.config(harness.FOLDER, scene=str(two_arms()), arms=["left"], cameras=cameras)
        robot = self.packages.robot_package.Multipanda(config)
        self.assertEqual(robot.observation_features["top"], (4, 6, 3))
        robot.connect()
        self.assertEqual(robot.get_observation()["top"].shape, (4, 6, 3))
        run = robot.arms.client
        robot.send_action({n: v for n, v in robot.get_observation().items() if n in robot.action_features})
        self.assertFalse(held(run, ["left"]))
        robot.cameras["top"].is_connected = False  # unplugged
        with self.assertRaisesRegex(ConnectionError, "not connected"):
            robot.get_observation()
        self.assertTrue(held(run, ["left"]))
        robot.disconnect()
        config.cameras["top"].fails = True
        with self.assertRaisesRegex(ConnectionError, "no camera"):
            robot.connect()
        self.assertEqual(harness.sockets(), [])

    @unittest.skipIf(importlib.util.find_spec("OpenGL") is None, "PyOpenGL is not installed")
    def test_cameras_of_the_scene_are_part_of_the_observation(self):
        cameras = {"front": {"position_m": [1.4, -1, 1], "look_at_m": [0.4, 0, 0.3], "width": 64, "height": 48}}
        with self.assertRaisesRegex(ValueError, "expected `scene`"):
            self.config(harness.FOLDER, arms=["left"], scene_cameras=cameras)
        config = self.config(harness.FOLDER, scene=str(two_arms()), arms=["left"], scene_cameras=cameras)
        robot = self.packages.robot_package.Multipanda(config)
        self.assertEqual(robot.observation_features["front"], (48, 64, 3))
        robot.connect()
        picture = robot.get_observation()["front"]
        self.assertEqual((picture.shape, picture.dtype), ((48, 64, 3), np.uint8))
        self.assertGreater(picture.std(), 5)  # it shows something
        robot.disconnect()
        self.assertEqual(harness.sockets(), [])

    def test_leaders(self):
        package = self.packages.teleoperator_package
        self.assertEqual(package.MultipandaSpaceMouseConfig().type, "multipanda_space_mouse")
        servos = package.MultipandaServoLeaderConfig(
            id="test", calibration_dir=harness.FOLDER, arms=["a"], files={"a": "a.json"}, grippers=["a"]
        )
        self.assertEqual(servos.type, "multipanda_servo_leader")
        leader = package.MultipandaServoLeader(servos)
        self.assertEqual(list(leader.action_features)[-2:], ["a_joint7.pos", "a_gripper.pos"])
        with self.assertRaisesRegex(mp.Refused, "a.json is not a calibration of a leader"):
            leader.connect()
        with self.assertRaisesRegex(ValueError, "files: expected one for each of the arms a"):
            package.MultipandaServoLeaderConfig(arms=["a"])
        config = package.MultipandaLeaderConfig(
            id="test", calibration_dir=harness.FOLDER, scene=str(two_arms()), leaders=["left"], arms=["arm"]
        )
        self.assertEqual(config.type, "multipanda_leader")
        leader = package.MultipandaLeader(config)
        self.assertEqual(leader.feedback_features, {})
        with leader:
            self.assertEqual(leader.leader.client.arms["left"].state.controllet, "left_guide")
            self.assertEqual(list(leader.get_action()), list(leader.action_features))
            with self.assertRaises(NotImplementedError):
                leader.send_feedback({})
        with self.assertRaisesRegex(ConnectionError, "not connected"):
            leader.get_action()

    def test_names_are_those_that_discovery_looks_for(self):
        for kind in ("robot", "teleoperator"):
            name = f"lerobot_{kind}_multipanda"
            about = (ROOT / "python/for_lerobot" / name / "pyproject.toml").read_text(encoding="utf-8")
            self.assertIn(f'\nname = "{name}"\n', about)
            self.assertTrue((ROOT / "python/for_lerobot" / name / name / "__init__.py").exists())


if __name__ == "__main__":
    harness.main()
