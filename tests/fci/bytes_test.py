#!/usr/bin/env python3
"""Compares the bytes of our client with those of unmodified libfranka for the same commands: bytes_test.py PROGRAM

Both control the same arm in lock-step. Only the UDP port of the program and the arm's clock at the start of a motion
may differ.
"""

import os
import struct
import subprocess
import sys
import unittest

from relay import Relay
from virtual_arms import HERE, free_address

PROGRAM = ""
TORQUES, MOTION = 120, 200
IDENTITY = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def torques(k):
    return [((k * (j + 1)) % 16 - 7.5) / (64 << j) for j in range(7)]


def velocity(k):
    x = k / 100.0 if k < 100 else (200 - k) / 100.0
    return 0.02 * x * x * x * (10 + x * (6 * x - 15))


def shifted(x, y, z):
    return IDENTITY[:12] + [x, y, z, 1.0]


def counted(first):
    return [float(first + i) for i in range(7)]


def set_all(robot, set_k, set_ee):
    robot.set_collision_behavior(counted(20), counted(30), counted(20)[:6], counted(60)[:6])
    robot.set_joint_impedance([3000.0, 3000, 3000, 2500, 2500, 2000, 2000])
    robot.set_cartesian_impedance([3000.0, 2900, 2800, 300, 290, 280])
    set_k(shifted(0.125, 0.25, 0.5))
    set_ee(shifted(0, 0, 0.0625))
    robot.set_load(0.015625, [0.0, 0, 0.125], [0.00390625, 0, 0, 0, 0.00390625, 0, 0, 0, 0.00390625])


def newest_library(address):
    """libfranka 0.21, protocol 10."""
    import pylibfranka as franka

    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)

    def motion(control, fill):
        command = None
        for k in range(MOTION + 1):
            state, _ = control.readOnce()
            command = fill(command, state, k)
            command.motion_finished = k == MOTION
            control.writeOnce(command)

    joints, hand = franka.ControllerMode.JointImpedance, franka.ControllerMode.CartesianImpedance
    # These commands begin at the measured state, so they come first, with the arm at the scene's start.
    motion(
        robot.start_joint_position_control(joints),
        lambda last, state, k: last or franka.JointPositions(list(state.q_d)),
    )
    motion(
        robot.start_cartesian_pose_control(hand),
        lambda last, state, k: last or franka.CartesianPose(list(state.O_T_EE_c)),
    )

    set_all(robot, robot.set_K, robot.set_EE)

    def torque_cycles(control, count, finish):
        for k in range(count):
            control.readOnce()
            command = franka.Torques(torques(k))
            command.motion_finished = finish and k + 1 == count
            control.writeOnce(command)

    control = robot.start_torque_control()
    torque_cycles(control, TORQUES, True)
    del control

    control = robot.start_torque_control()
    torque_cycles(control, 30, False)
    del control  # cancels

    motion(
        robot.start_joint_velocity_control(joints),
        lambda _, state, k: franka.JointVelocities([0.0] * 6 + [velocity(k)]),
    )
    motion(
        robot.start_cartesian_velocity_control(hand),
        lambda _, state, k: franka.CartesianVelocities([0.0, 0, velocity(k) / 4, 0, 0, 0]),
    )

    control = robot.start_torque_control()
    try:
        for k in range(9):
            control.readOnce()
            control.writeOnce(franka.Torques(torques(k)))
        control.readOnce()
        control.writeOnce(franka.Torques([5.0] + [0.0] * 6))
        control.readOnce()
        raise AssertionError("a torque step was accepted")
    except franka.ControlException:
        pass
    del control
    robot.automatic_error_recovery()


def panda_library(address):
    """libfranka 0.9, protocol 5."""
    from panda_py import libfranka

    robot = libfranka.Robot(address, libfranka.RealtimeConfig.kIgnore)
    set_all(robot, robot.set_k, robot.set_ee)
    robot.set_collision_behavior(
        counted(10),
        counted(40),
        counted(20),
        counted(50),
        counted(10)[:6],
        counted(40)[:6],
        counted(20)[:6],
        counted(50)[:6],
    )
    robot.set_guiding_mode([True, False, True, False, True, False], True)

    class CutOff(Exception):
        pass

    def control(count, end):
        cycle = -1

        def law(state, period):
            nonlocal cycle
            cycle += 1
            if cycle == count:
                if end == "cut off":
                    raise CutOff
                return libfranka.Torques([5.0] + [0.0] * 6)
            command = libfranka.Torques(torques(cycle))
            command.motion_finished = end == "finish" and cycle + 1 == count
            return command

        robot.control(law, False, 1000.0)

    control(TORQUES, "finish")
    try:
        control(30, "cut off")
    except CutOff:
        pass
    try:
        control(9, "jump")
        raise AssertionError("a torque step was accepted")
    except RuntimeError as reflex:
        assert "controller_torque_discontinuity" in str(reflex), reflex
    robot.automatic_error_recovery()


class Bytes(unittest.TestCase):
    def record(self, scene, drive):
        arm_address, address = free_address(100), free_address(101)
        with subprocess.Popen(
            [PROGRAM, "serve", arm_address, str(scene)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as arm:
            self.assertEqual(arm.stdout.readline().strip(), "listening")

            def step():
                arm.stdin.write(".")
                arm.stdin.flush()

            with Relay(address, arm_address, step) as relay:
                drive(address)
            arm.stdin.close()
            self.assertEqual(arm.wait(20), 0)
        return relay

    def compare(self, scene, library, version):
        # In a separate process: the library holds Python's lock while it waits, which would stop the relay.
        own = [sys.executable, os.path.abspath(__file__), "drive", library.__name__]
        theirs = self.record(scene, lambda address: subprocess.run([*own, address], check=True, timeout=60))
        ours = self.record(
            scene, lambda address: subprocess.run([PROGRAM, "drive", address, str(version)], check=True, timeout=60)
        )
        self.assertEqual(
            [m[:2] for m in ours.messages()], [m[:2] for m in theirs.messages()], "requests and their numbers"
        )
        for mine, other in zip(ours.messages(), theirs.messages()):
            self.assertEqual(mine, other)
        self.assertEqual([len(m) for m in ours.motions], [len(m) for m in theirs.motions], "commands of each motion")
        self.assertGreaterEqual(len(theirs.motions[0]), TORQUES)
        for i, motions in enumerate(zip(ours.motions, theirs.motions)):
            # The arm's clock also runs between motions; in a motion both must answer the same states.
            first = [struct.unpack_from("<Q", motion[0])[0] for motion in motions]
            for k, commands in enumerate(zip(*motions)):
                answers = [struct.unpack_from("<Q", command)[0] - begin for command, begin in zip(commands, first)]
                self.assertEqual(answers[0], answers[1], f"motion {i}: state that command {k} answers")
                self.assertEqual(commands[0][8:], commands[1][8:], f"motion {i}, command {k}")
        count = sum(len(m) for m in theirs.motions)
        print(f"version {version}: {len(theirs.messages())} requests, {count} commands, all bytes equal")

    def test_fr3(self):
        self.compare(HERE / "bytes_fr3.yaml", newest_library, 10)

    def test_panda(self):
        self.compare(HERE / "bytes_panda.yaml", panda_library, 5)


if __name__ == "__main__":
    try:
        import panda_py  # noqa: F401
        import pylibfranka  # noqa: F401
    except ImportError as missing:
        print(f"skipped: {missing}; ./multipanda setup installs the libraries")
        sys.exit(77)
    if sys.argv[1] == "drive":
        globals()[sys.argv[2]](sys.argv[3])
        sys.exit(0)
    PROGRAM = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
