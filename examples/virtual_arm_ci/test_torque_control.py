"""Example tests: unmodified pylibfranka programs, and checks of the arm's motion."""

import numpy as np
import pylibfranka as franka
import pytest


def connect(arm):
    # kIgnore: a CI machine has no real-time kernel, and lock-step does not need one.
    return franka.Robot(arm.address, franka.RealtimeConfig.kIgnore)


# Softer for joints that move little mass.
STIFFNESS = np.array([100, 100, 100, 100, 30, 20, 10.0])  # [N m/rad]
DAMPING = np.array([20, 20, 20, 20, 3, 2, 1.0])  # [N m s/rad]


def spring(robot, goal, milliseconds):
    """Moves the joints to `goal` by springs; returns the states of every period."""
    control = robot.start_torque_control()
    states = []
    tau = np.zeros(7)
    for k in range(milliseconds):
        state, _ = control.readOnce()
        states.append(state)
        desired = STIFFNESS * (goal - np.array(state.q)) - DAMPING * np.array(state.dq)
        tau = tau + np.clip(desired - tau, -0.9, 0.9)  # an arm accepts at most 1000 N m/s
        command = franka.Torques(list(tau))
        command.motion_finished = k == milliseconds - 1
        control.writeOnce(command)
    return states


def test_the_arm_reaches_the_goal(arm):
    robot = connect(arm)
    start = np.array(robot.read_once().q)
    goal = start + [0.1, 0, 0, 0, 0, 0, -0.2]
    states = spring(robot, goal, 3000)
    assert np.abs(np.array(states[-1].q) - goal).max() < 0.01


def test_the_arm_stays_at_the_start(arm):
    robot = connect(arm)
    start = np.array(robot.read_once().q)
    assert np.allclose(start, [0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4], atol=1e-6)
    states = spring(robot, start, 500)  # the arm compensates gravity
    assert max(np.abs(np.array(state.q) - start).max() for state in states) < 1e-3


def test_a_torque_step_stops_the_arm(arm):
    robot = connect(arm)
    control = robot.start_torque_control()
    control.readOnce()
    control.writeOnce(franka.Torques([5.0, 0, 0, 0, 0, 0, 0]))
    with pytest.raises(franka.ControlException, match="controller_torque_discontinuity"):
        for _ in range(5):
            control.readOnce()
            control.writeOnce(franka.Torques([5.0, 0, 0, 0, 0, 0, 0]))
    assert robot.read_once().robot_mode == franka.RobotMode.Reflex
    robot.automatic_error_recovery()
    assert robot.read_once().robot_mode == franka.RobotMode.Idle


def test_the_external_force_is_estimated(arm):
    robot = connect(arm)
    arm.tell("push arm 0 0 -15 1")  # 15 N downwards on the flange, for 1 s of the arm's time
    states = spring(robot, np.array(robot.read_once().q), 800)
    # Pushed downwards, the arm exerts an upward force.
    assert states[-1].O_F_ext_hat_K[2] == pytest.approx(15, abs=2)
