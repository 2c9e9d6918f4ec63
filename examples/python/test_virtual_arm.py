"""Tests of programs against virtual arms: pytest examples/python/test_virtual_arm.py

Copy the first line below into your own tests. Each test has a world of its own, which waits for its program: a busy
computer loses no packet, and every run gives the same numbers.
"""

pytest_plugins = ["multipanda.pytest_plugin"]

import numpy as np
import pylibfranka as franka


def test_a_libfranka_program(multipanda_virtual_arms):
    """An unmodified program: only the address differs."""
    # The scene's arm is a Panda; pylibfranka speaks version 10, that of a Franka Research 3.
    arms = multipanda_virtual_arms("one_arm", arm_names=("arm",), arguments=("--protocol", "arm=10"))
    robot = franka.Robot(arms.addresses["arm"], franka.RealtimeConfig.kIgnore)
    start = np.array(robot.read_once().q)

    control = robot.start_torque_control()
    arms.tell("push arm 0 0 -15 0.2")  # [N], for 0.2 s
    for k in range(500):
        state, _ = control.readOnce()
        torques = franka.Torques([0.0] * 7)  # the arm compensates its gravity, and nothing else holds it
        torques.motion_finished = k == 499
        control.writeOnce(torques)
    assert np.abs(np.array(state.q) - start).max() > 0.001  # pushed away


def test_a_program_of_multipanda(multipanda_run):
    run = multipanda_run("one_arm", fast=True)
    start = run.arms["arm"].state.pose
    state = run["cartesian"].goal("pose", start.moved(z=0.05), duration_s=1).wait()
    assert abs(state.pose.position_m[2] - start.position_m[2] - 0.05) < 0.01
