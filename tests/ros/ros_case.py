"""Shared by the tests of the ROS interfaces: one run of tests/ros/scene.yaml and one client for all of them."""

import pathlib
import unittest

import kinematics
import numpy as np
import ros_run

HERE = pathlib.Path(__file__).resolve().parent
ARMS = ("left", "right")


class RosCase(unittest.TestCase):
    program = None
    run_, client = None, None

    @classmethod
    def begin(cls, program):
        RosCase.program = program
        RosCase.client = ros_run.Client(ros_run.own_domain())  # before the run, so that it sees the run come up
        RosCase.run_ = ros_run.Run(
            program, HERE / "scene.yaml", "--seconds", "600", domain=ros_run.own_domain()
        ).__enter__()

    def setUp(self):
        from multipanda_msgs.srv import SwitchControllets

        if not self.run_.alive():
            self.fail("the run has ended: " + "".join(self.run_.output))
        begin = {"activate": ["left_pose", "right_pose"], "only": True}
        response = self.call(SwitchControllets, "/multipanda/switch_controllets", **begin)
        if not response.accepted:  # after a failed test, or a machine that was too slow for an arm
            self.recover_all()
            response = self.call(SwitchControllets, "/multipanda/switch_controllets", **begin)
        self.assertTrue(response.accepted, response.reason)

    def recover_all(self):
        from multipanda_msgs.msg import RobotState
        from multipanda_msgs.srv import RecoverFromError, ResumeArms
        from std_srvs.srv import SetBool

        self.call(SetBool, "/simulation/pause", data=False)
        self.call(ResumeArms, "/multipanda/resume")
        for arm in ARMS:
            self.call(SetBool, f"/{arm}/set_user_stop", data=False)
            if self.state(arm).mode != RobotState.MODE_MOVE:
                self.call(RecoverFromError, f"/{arm}/recover")
            self.wait(lambda a=arm: self.states(a).newest().mode == RobotState.MODE_MOVE, f"{arm} ready")

    def call(self, *arguments, **fields):
        return self.client.call(*arguments, **fields)

    def topic(self, *arguments, **options):
        return self.client.topic(*arguments, **options)

    def wait(self, *arguments, **options):
        return ros_run.wait_for(*arguments, **options)

    def switch(self, *activate, **more):
        from multipanda_msgs.srv import SwitchControllets

        return self.call(SwitchControllets, "/multipanda/switch_controllets", activate=list(activate), **more)

    def switched(self, *activate):
        response = self.switch(*activate)
        self.assertTrue(response.accepted, response.reason)

    def state(self, arm):
        """Returns a robot state that was measured after this call: the second to arrive."""
        return self.states(arm).next(3)

    def owned(self, arm, owner):
        """Waits until the arm's state reports the owner, which may be late if the client is busy."""
        states = self.states(arm)
        return self.wait(lambda: (m := states.newest()) and m.owner == owner and m, f"{arm} owned by {owner}")

    def states(self, arm):
        from multipanda_msgs.msg import RobotState

        return self.topic(RobotState, f"/{arm}/robot_state")

    def statistics(self):
        """Returns loop statistics from after this call."""
        from multipanda_msgs.msg import LoopStatistics

        return self.topic(LoopStatistics, "/multipanda/loop_statistics").next(2)

    def position(self, arm):
        return kinematics.of_pose(self.state(arm).pose)[:3, 3]

    def at(self, arm, position, tolerance=3e-3, timeout=30.0):
        """Waits until the arm's end effector is there."""
        states = self.states(arm)

        def near():
            newest = states.newest()
            return newest and np.linalg.norm(kinematics.of_pose(newest.pose)[:3, 3] - position) < tolerance

        self.wait(near, f"{arm} at {position}, but at {self.position(arm)}", timeout=timeout)

    def refused(self, response, *expected):
        """Checks that a request was refused with a human-readable reason that contains the expected texts."""
        accepted = response.accepted if hasattr(response, "accepted") else response.success
        text = next(getattr(response, key) for key in ("reason", "error", "message") if hasattr(response, key))
        self.assertFalse(accepted)
        for part in expected:
            self.assertIn(part, text)

    def base(self, arm):
        """Returns X_WB from the robot description."""
        return self.robot().link(f"{arm}_link0", {})

    def robot(self):
        from std_msgs.msg import String

        description = self.topic(String, "/robot_description", latched=True)
        self.wait(description.newest, "a robot description")
        return kinematics.Robot(description.newest().data)


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def nanoseconds(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec
