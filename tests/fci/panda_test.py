#!/usr/bin/env python3
"""Tests unmodified panda-py (libfranka 0.9, protocol 5) with virtual arms: panda_test.py PROGRAM [TEST...]"""

import itertools
import math
import os
import sys
import threading
import time
import unittest
from datetime import timedelta

import numpy as np
import panda_py
from panda_py import controllers, libfranka
from pylibfranka_test import pose_of
from virtual_arms import HERE, PATIENCE_S, VirtualArms

PROGRAM = ""
SCENE = HERE / "two_generations.yaml"


class Arms(unittest.TestCase):
    scene, names = SCENE, ["panda", "fr3"]

    @classmethod
    def setUpClass(cls):
        options = ["--protocol", "fr3=any"]  # a real one refuses version 5
        cls.arms = VirtualArms(PROGRAM, cls.scene, cls.names, options=options).__enter__()
        cls.robots = {}

    @classmethod
    def tearDownClass(cls):
        cls.robots.clear()
        cls.arms.__exit__()

    def robot(self, name="panda"):
        if name not in self.robots:
            self.robots[name] = libfranka.Robot(self.arms.address[name], libfranka.RealtimeConfig.kIgnore)
        robot = self.robots[name]
        if robot.read_once().robot_mode == libfranka.RobotMode.kReflex:
            robot.automatic_error_recovery()
        settled = robot.read_once().time.to_sec() + 0.3  # after the motion of the previous test
        robot.read(lambda state: state.time.to_sec() < settled)
        return robot


class Library(Arms):
    def test_version_state_and_model(self):
        robot = self.robot()
        self.assertEqual(robot.server_version(), 5)
        state, model = robot.read_once(), robot.load_model()
        np.testing.assert_allclose(model.gravity(state), state.tau_J, atol=0.3)  # the declared hand is not exact
        np.testing.assert_allclose(
            pose_of(model.pose(libfranka.Frame.kEndEffector, state)), pose_of(state.O_T_EE), atol=2e-5
        )
        mass = np.array(model.mass(state)).reshape(7, 7)
        np.testing.assert_allclose(mass, mass.T, atol=1e-9)
        self.assertGreater(np.linalg.eigvalsh(mass)[0], 0)

    def test_callback_loop_ends_and_a_throwing_one_stops_the_arm(self):
        robot = self.robot()
        q = np.array(robot.read_once().q)
        count = 0

        def spring(state, period):
            nonlocal count
            count += 1
            tau = libfranka.Torques(list(40 * (q - np.array(state.q)) - 8 * np.array(state.dq)))
            tau.motion_finished = count == 500
            return tau

        robot.control(spring)
        self.assertEqual(count, 500)

        def throwing(state, period):
            raise RuntimeError("enough")

        with self.assertRaises(RuntimeError):
            robot.control(throwing)
        self.assertEqual(robot.read_once().robot_mode, libfranka.RobotMode.kIdle)

    def test_an_abort_says_why_and_the_next_motion_runs(self):
        robot = self.robot()

        def run(at_50):
            count = itertools.count()

            def law(state, period):
                n = next(count)
                tau = libfranka.Torques([at_50() if n == 50 else 0.0] + [0.0] * 6)
                tau.motion_finished = n == 300
                return tau

            robot.control(law, limit_rate=False, cutoff_frequency=1000.0)

        def told(words):
            self.arms.control(words)
            return 0.0

        for reason, way in {
            "controller_torque_discontinuity": lambda: 5.0,
            "cartesian_reflex": lambda: told("reflex panda cartesian_reflex"),
            "User Stop pressed": lambda: told("user-stop panda on"),
        }.items():
            with self.assertRaisesRegex(RuntimeError, reason):
                run(way)
            self.arms.control("user-stop panda off")
            self.robot()  # recovered
            run(lambda: 0.0)

    def test_reading_with_a_callback(self):
        seen = []
        self.robot().read(lambda state: seen.append(state.time.to_sec()) or len(seen) < 20)
        self.assertEqual(sorted(seen), seen)

    def test_wrenches_about_the_base_and_about_k(self):
        """A known force on the flange of a turned arm, with end effector and K where a program has put them."""
        robot = self.robot()
        robot.set_ee([0.8, 0.6, 0, 0, -0.6, 0.8, 0, 0, 0, 0, 1, 0, 0.05, -0.1, 0.03, 1])
        robot.set_k([0, 0, -1, 0, 0.6, 0.8, 0, 0, 0.8, -0.6, 0, 0, 0.08, -0.05, 0.1, 1])
        push = np.array([6.0, -9.0, 7.0])
        self.arms.control("push panda 6 -9 7 3")
        pushed = robot.read_once().time.to_sec() + 1.5
        robot.read(lambda state: state.time.to_sec() < pushed)
        state = robot.read_once()
        O_T_EE = pose_of(state.O_T_EE)
        O_T_K, flange = O_T_EE @ pose_of(state.EE_T_K), (O_T_EE @ np.linalg.inv(pose_of(state.F_T_EE)))[:3, 3]
        c, s = np.cos(np.pi / 5), np.sin(np.pi / 5)  # the base in the scene
        f, R_K = -np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ push, O_T_K[:3, :3]
        np.testing.assert_allclose(state.O_F_ext_hat_K, [*f, *np.cross(flange, f)], atol=0.1)
        about_k = np.cross(flange - O_T_K[:3, 3], f)
        np.testing.assert_allclose(state.K_F_ext_hat_K, [*(R_K.T @ f), *(R_K.T @ about_k)], atol=0.1)
        robot.set_ee(list(np.eye(4).ravel()))
        robot.set_k(list(np.eye(4).ravel()))
        ended = robot.read_once().time.to_sec() + 2
        robot.read(lambda state: state.time.to_sec() < ended)

    def test_setters_and_recovery(self):
        robot = self.robot()
        robot.set_collision_behavior(
            [20.0] * 7, [20.0] * 7, [10.0] * 7, [80.0] * 7, [20.0] * 6, [20.0] * 6, [10.0] * 6, [100.0] * 6
        )
        robot.set_collision_behavior([20.0] * 7, [80.0] * 7, [20.0] * 6, [100.0] * 6)
        robot.set_joint_impedance([3000.0, 3000, 3000, 2500, 2500, 2000, 2000])
        robot.set_cartesian_impedance([3000.0, 3000, 3000, 300, 300, 300])
        robot.set_guiding_mode([True] * 6, False)
        robot.set_load(0.3, [0, 0, 0.05], [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3])
        self.assertAlmostEqual(robot.read_once().m_load, 0.3)
        robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
        self.arms.control("reflex panda cartesian_reflex")
        deadline = time.monotonic() + PATIENCE_S
        while robot.read_once().robot_mode != libfranka.RobotMode.kReflex and time.monotonic() < deadline:
            pass
        self.assertTrue(robot.read_once().current_errors.cartesian_reflex)
        robot.automatic_error_recovery()
        self.assertEqual(robot.read_once().robot_mode, libfranka.RobotMode.kIdle)
        robot.stop()


class Program(Arms):
    def test_moving_and_controllers(self):
        panda = panda_py.Panda(self.arms.address["panda"])
        panda.set_default_behavior()
        start = np.array([0, -math.pi / 4, 0, -3 * math.pi / 4, 0, math.pi / 2, math.pi / 4])
        panda.move_to_joint_position(start + 0.1)
        np.testing.assert_allclose(panda.q, start + 0.1, atol=0.02)
        pose = np.array(panda.get_pose())
        pose[2, 3] -= 0.05
        panda.move_to_pose(pose)
        np.testing.assert_allclose(np.array(panda.get_pose())[:3, 3], pose[:3, 3], atol=0.01)
        panda.start_controller(controllers.JointPosition())
        began = panda.get_state().time.to_sec()
        while panda.get_state().time.to_sec() < began + 0.5:
            time.sleep(0.001)
        panda.stop_controller()
        panda.move_to_start()
        np.testing.assert_allclose(panda.q, start, atol=0.02)

    def test_two_pandas_at_once(self):
        arms = [panda_py.Panda(self.arms.address[name]) for name in self.names]
        goals = [np.array(arm.q) + 0.1 for arm in arms]
        threads = [threading.Thread(target=arm.move_to_joint_position, args=(goal,)) for arm, goal in zip(arms, goals)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for arm, goal in zip(arms, goals):
            np.testing.assert_allclose(arm.q, goal, atol=0.02)


class Hand(unittest.TestCase):
    def test_a_box_between_the_fingers_is_held(self):
        with VirtualArms(PROGRAM, HERE / "box_in_hand.yaml", ["arm"]) as arms:
            gripper = libfranka.Gripper(arms.address["arm"])
            self.assertTrue(gripper.grasp(0.05, 0.1, 40.0))
            state = gripper.read_once()
            self.assertTrue(state.is_grasped)
            self.assertAlmostEqual(state.width, 0.05, delta=2e-3)
            robot = libfranka.Robot(arms.address["arm"], libfranka.RealtimeConfig.kIgnore)
            self.assertTrue(gripper.move(0.08, 0.1))
            self.assertFalse(gripper.read_once().is_grasped)
            self.assertEqual(robot.read_once().robot_mode, libfranka.RobotMode.kIdle)


class Vacuum(unittest.TestCase):
    def test_vacuum_and_drop(self):
        with VirtualArms(PROGRAM, HERE / "box_under_vacuum.yaml", ["arm"]) as arms:
            gripper = libfranka.VacuumGripper(arms.address["arm"])
            self.assertTrue(gripper.vacuum(10, timedelta(milliseconds=1500)))
            self.assertTrue(gripper.read_once().part_present)
            self.assertTrue(gripper.drop_off(timedelta(milliseconds=1500)))
            self.assertTrue(gripper.stop())


if __name__ == "__main__":
    PROGRAM = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
