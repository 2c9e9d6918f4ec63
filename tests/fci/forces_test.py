#!/usr/bin/env python3
"""Checks the forces that a libfranka program receives, on a plant without friction or noise: forces_test.py PROGRAM

At rest the true force follows from statics: without gravity and friction in the torques, tau_d = J^T F. This reference
is independent of the arm's observer, its filter and the simulator's contacts.
"""

import os
import sys
import unittest

import numpy as np
import pylibfranka as franka
from pylibfranka_test import connect, pose_of, spring
from virtual_arms import HERE, VirtualArms

PROGRAM = ""


def jacobian_of(model, state):
    return np.array(model.zero_jacobian(state)).reshape(7, 6).T


class Pressing(unittest.TestCase):
    def press(self, robot, model, force, cycles):
        """As libfranka's force example: presses along -z of the base. Returns state and exerted wrench."""
        first = robot.read_once()
        x_d = pose_of(first.O_T_EE)[:3, 3]
        rotation_d = pose_of(first.O_T_EE)[:3, :3]
        control = robot.start_torque_control()
        for n in range(cycles):
            state, _ = control.readOnce()
            jacobian = jacobian_of(model, state)
            pose, dx = pose_of(state.O_T_EE), jacobian @ np.array(state.dq)
            error = pose[:3, :3] @ rotation_d.T
            turn = 0.5 * np.array([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]])
            wrench = (
                np.concatenate([-500 * (pose[:3, 3] - x_d), -15 * turn]) - np.array([60, 60, 60, 0.7, 0.7, 0.7]) * dx
            )
            wrench[2] = -force * min(1.0, n / 1000) - 150 * dx[2]
            tau = jacobian.T @ wrench - 0.3 * np.array(state.dq) + np.array(model.coriolis(state))
            command = franka.Torques(list(tau))
            command.motion_finished = n + 1 == cycles
            control.writeOnce(command)
        exerted = np.linalg.lstsq(jacobian.T, np.array(state.tau_J_d), rcond=None)[0]
        return state, jacobian, exerted

    def test_wrench_and_joint_torques_while_pressing(self):
        """The table bears a force alone, at the lowest point of the ball: its moments about the base's origin and about
        K follow from where these are, also after a program has moved K."""
        # Without rotors it comes to rest in time: the program damps what does not press by 0.3 N m s/rad.
        with VirtualArms(PROGRAM, HERE / "table_press.yaml", ["arm"], options=["--rotor-hidden", "1"]) as arms:
            robot = connect(arms.address["arm"])
            model = robot.load_model()
            robot.set_collision_behavior([80.0] * 7, [80.0] * 7, [100.0] * 6, [100.0] * 6)
            ball = pose_of(robot.read_once().F_T_EE)[:, 3]
            for force, moved in ((10.0, False), (25.0, True)):
                if moved:
                    robot.set_K([0, 0, -1, 0, 0.6, 0.8, 0, 0, 0.8, -0.6, 0, 0, 0.08, -0.05, 0.1, 1])
                state, jacobian, exerted = self.press(robot, model, force, 4000)
                self.assertLess(np.abs(state.dq).max(), 2e-3)
                self.assertAlmostEqual(exerted[2], -force, delta=0.3)
                O_T_EE, O_T_K = pose_of(state.O_T_EE), pose_of(state.O_T_EE) @ pose_of(state.EE_T_K)
                touch = (O_T_EE @ np.linalg.inv(pose_of(state.F_T_EE)) @ ball)[:3] - [0, 0, 0.02]
                f, R_K = exerted[:3], O_T_K[:3, :3]
                in_base = np.array(state.O_F_ext_hat_K) - [*f, *np.cross(touch, f)]
                in_k = np.array(state.K_F_ext_hat_K) - [*(R_K.T @ f), *(R_K.T @ np.cross(touch - O_T_K[:3, 3], f))]
                print(
                    f"\n  {force:.0f} N: error {np.abs(in_base[:3]).max():.4f} N, {np.abs(in_base[3:]).max():.4f} N m "
                    f"about the base, {np.abs(in_k[3:]).max():.4f} N m about K; "
                    f"joints by {np.abs(np.array(state.tau_ext_hat_filtered) - jacobian.T @ exerted).max():.4f} N m",
                    flush=True,
                )
                self.assertGreater(np.linalg.norm(np.cross(touch, f)), 0.25 * force)
                for error in (in_base, in_k):
                    np.testing.assert_allclose(error[:3], np.zeros(3), atol=0.3)
                    np.testing.assert_allclose(error[3:], np.zeros(3), atol=0.1)
                np.testing.assert_allclose(state.tau_ext_hat_filtered, jacobian.T @ exerted, atol=0.1)


class Thresholds(unittest.TestCase):
    """Pushes an arm that the program holds with a known force, with thresholds just above and just below it."""

    @classmethod
    def setUpClass(cls):
        cls.arms = VirtualArms(PROGRAM, HERE / "table_press.yaml", ["arm"]).__enter__()
        cls.robot = connect(cls.arms.address["arm"])

    @classmethod
    def tearDownClass(cls):
        cls.arms.__exit__()

    def pushed(self, torque, force, newtons):
        """Pushes the flange along z with thresholds (lower, upper). Returns the last state or the exception."""
        state = self.robot.read_once()
        if state.robot_mode == franka.RobotMode.Reflex:
            self.robot.automatic_error_recovery()
        while self.robot.read_once().time.to_sec() < state.time.to_sec() + 1:  # until an earlier push has ended
            pass
        self.robot.set_collision_behavior([torque[0]] * 7, [torque[1]] * 7, [force[0]] * 6, [force[1]] * 6)
        q = np.array(self.robot.read_once().q)
        law = spring(q)
        control = self.robot.start_torque_control()
        try:
            contact = np.zeros(6), np.zeros(7)
            for n in range(1500):
                state, _ = control.readOnce()
                if n == 200:
                    self.arms.control(f"push arm 0 0 {newtons} 0.8")
                contact = np.maximum(contact[0], state.cartesian_contact), np.maximum(contact[1], state.joint_contact)
                command = franka.Torques(law(state, n))
                command.motion_finished = n == 1499
                control.writeOnce(command)
            state = self.robot.read_once()
            self.assertEqual(state.robot_mode, franka.RobotMode.Idle)
            return state, contact, None
        except franka.ControlException as error:
            del control
            return self.robot.read_once(), contact, str(error)

    def test_below_the_lower_threshold_there_is_no_contact(self):
        _, contact, error = self.pushed((80, 80), (25, 100), 20)
        self.assertIsNone(error)
        self.assertFalse(contact[0].any() or contact[1].any())

    def test_between_the_thresholds_is_contact(self):
        _, contact, error = self.pushed((80, 80), (12, 40), 20)
        self.assertIsNone(error)
        self.assertEqual(contact[0][2], 1.0)

    def test_above_the_upper_threshold_is_a_cartesian_reflex(self):
        state, _, error = self.pushed((80, 80), (10, 15), 25)
        self.assertIn("cartesian_reflex", error)
        self.assertEqual(state.cartesian_collision[2], 1.0)
        self.assertTrue(state.current_errors.cartesian_reflex)
        self.robot.automatic_error_recovery()
        self.assertFalse(any(self.robot.read_once().cartesian_collision))

    def test_above_a_joint_s_threshold_is_a_joint_reflex(self):
        state, _, error = self.pushed((1, 5), (100, 100), 25)
        self.assertIn("joint_reflex", error)
        self.assertTrue(any(state.joint_collision))


if __name__ == "__main__":
    PROGRAM = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
