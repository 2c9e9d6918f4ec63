"""Every action: reached, refused, canceled, and replaced by a newer goal."""

import kinematics
import numpy as np
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory, GripperCommand
from geometry_msgs.msg import Pose
from multipanda_msgs.action import CartesianViaMotion, Grasp, Homing, JointViaMotion, Move
from multipanda_msgs.msg import JointPose
from ros_case import RosCase
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectoryPoint

SUCCEEDED, CANCELED, ABORTED = GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED


class Motions(RosCase):
    def goal_of(self, *offsets, scale=0.3):
        q = np.array(self.state("left").q)
        return JointViaMotion.Goal(
            via_poses=[JointPose(positions=[float(v) for v in q + offset]) for offset in offsets], velocity_scale=scale
        )

    def joints_at(self, q, tolerance=5e-3):
        self.wait(lambda: np.max(np.abs(np.array(self.states("left").newest().q) - q)) < tolerance, "the joints there")

    def run_goal(self, kind, name, goal, feedback=None):
        handle = self.client.send_goal(kind, name, goal, feedback)
        self.assertTrue(handle.accepted)
        return self.client.result(handle)

    def test_joints_through_via_points(self):
        status, result = self.run_goal(JointViaMotion, "/left/joint_via_motion", self.goal_of(np.zeros(7)))
        self.assertEqual((status, result.success), (ABORTED, False))  # no controllet that takes joints
        self.assertIn("left_joint", result.error)
        self.switched("left_joint")
        q = np.array(self.state("left").q)
        one, two = np.array([0.1, 0, 0, 0, 0, 0, 0.2]), np.array([0, 0.05, 0, 0, 0, 0, 0])
        progress = []
        status, result = self.run_goal(
            JointViaMotion, "/left/joint_via_motion", self.goal_of(one, two), lambda m: progress.append(m.feedback)
        )
        self.assertEqual((status, result.success, result.error), (SUCCEEDED, True, ""))
        self.joints_at(q + two)
        self.assertTrue(progress and all(0 <= f.progress <= 1 for f in progress))
        self.assertTrue(all(a.progress <= b.progress for a, b in zip(progress, progress[1:])))
        for goal, reason in [
            (JointViaMotion.Goal(velocity_scale=0.5), "joint position"),
            (self.goal_of(np.zeros(7), scale=1.5), "scale"),
            (JointViaMotion.Goal(via_poses=[JointPose(positions=[0.0] * 3)], velocity_scale=0.5), "7"),
            (self.goal_of(np.full(7, 9.0)), "rad"),
            (self.goal_of(np.full(7, np.nan)), ""),
        ]:
            status, result = self.run_goal(JointViaMotion, "/left/joint_via_motion", goal)
            self.assertEqual((status, result.success), (ABORTED, False))
            self.assertIn(reason, result.error)

    def test_cancel_and_preempt(self):
        self.switched("left_joint")
        q = np.array(self.state("left").q)
        far = np.array([0.5, 0, 0, 0, 0, 0, 0])
        handle = self.client.send_goal(JointViaMotion, "/left/joint_via_motion", self.goal_of(far, scale=0.05))
        self.wait(lambda: abs(self.states("left").newest().q[0] - q[0]) > 0.01, "motion")
        self.assertEqual(self.client.cancel(handle), 1)
        self.assertEqual(self.client.result(handle)[0], CANCELED)
        self.wait(lambda: np.max(np.abs(self.states("left").newest().dq)) < 2e-3, "rest")
        self.assertLess(self.state("left").q[0] - q[0], 0.3)
        first = self.client.send_goal(JointViaMotion, "/left/joint_via_motion", self.goal_of(far, scale=0.05))
        second = self.client.send_goal(JointViaMotion, "/left/joint_via_motion", self.goal_of(np.zeros(7)))
        self.assertEqual(self.client.result(first)[0], ABORTED)  # a newer goal took over
        self.assertEqual(self.client.result(second)[0], SUCCEEDED)
        third = self.client.send_goal(JointViaMotion, "/left/joint_via_motion", self.goal_of(far, scale=0.05))
        self.switched("left_guide")  # another controllet takes over
        self.assertEqual(self.client.result(third)[0], ABORTED)

    def test_poses_through_via_points(self):
        start = self.state("left").pose
        here = kinematics.of_pose(start)[:3, 3]
        X_BE = np.linalg.inv(self.base("left")) @ kinematics.of_pose(start)

        def goal(*shifts, frame_id="left_link0", scale=0.5):
            poses = []
            for shift in shifts:  # without an orientation: it is kept
                pose = Pose()
                pose.position.x, pose.position.y, pose.position.z = (float(v) for v in X_BE[:3, 3] + shift)
                pose.orientation.w = 0.0
                poses.append(pose)
            return CartesianViaMotion.Goal(frame_id=frame_id, via_poses=poses, velocity_scale=scale)

        status, result = self.run_goal(
            CartesianViaMotion, "/left/cartesian_via_motion", goal([0.03, 0, 0], [0, 0, 0.04])
        )
        self.assertEqual((status, result.error), (SUCCEEDED, ""))
        self.at("left", here + [0, 0, 0.04])
        turn = kinematics.of_pose(self.state("left").pose)[:3, :3].T @ kinematics.of_pose(start)[:3, :3]
        self.assertLess(np.arccos(min(1.0, (np.trace(turn) - 1) / 2)), 0.02)
        status, _ = self.run_goal(CartesianViaMotion, "/left/cartesian_via_motion", goal([0, 0, 0]))
        self.assertEqual(status, SUCCEEDED)
        for bad, reason in [
            (goal([0, 0, 0], frame_id="moon"), "moon"),
            (goal(), "pose"),
            (goal([0, 0, np.nan]), "finite"),
            (goal([0, 0, 0], scale=0.0), "scale"),
        ]:
            status, result = self.run_goal(CartesianViaMotion, "/left/cartesian_via_motion", bad)
            self.assertEqual((status, result.success), (ABORTED, False))
            self.assertIn(reason, result.error)

    def trajectory(self, *points, names=None):
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = names or [f"left_joint{k}" for k in range(1, 8)]
        for t, q in points:
            goal.trajectory.points.append(
                JointTrajectoryPoint(
                    positions=[float(v) for v in q], time_from_start=Duration(sec=int(t), nanosec=int(t % 1 * 1e9))
                )
            )
        return goal

    def test_trajectories(self):
        action, name = FollowJointTrajectory, "/left_arm_controller/follow_joint_trajectory"
        q = np.array(self.state("left").q)
        status, result = self.run_goal(action, name, self.trajectory((1.0, q)))
        self.assertEqual((status, result.error_code), (ABORTED, action.Result.INVALID_GOAL))
        self.assertIn("left_joint", result.error_string)
        self.switched("left_joint")
        q = np.array(self.state("left").q)
        move = np.array([0.05, -0.05, 0.05, 0, 0, 0.1, 0.1])
        errors = []
        status, result = self.run_goal(
            action,
            name,
            self.trajectory((1.0, q + move), (2.0, q + 0.5 * move)),
            lambda m: errors.append(m.feedback.error.positions),
        )
        self.assertEqual((status, result.error_code, result.error_string), (SUCCEEDED, action.Result.SUCCESSFUL, ""))
        self.joints_at(q + 0.5 * move)
        self.assertTrue(errors)
        self.assertLess(np.max(np.abs(np.array(errors))), 0.05)
        # some joints, in another order
        some = self.trajectory((1.0, [q[6], q[0]]), names=["left_joint7", "left_joint1"])
        self.assertEqual(self.run_goal(action, name, some)[0], SUCCEEDED)
        for bad, code in [
            (self.trajectory((1.0, q), names=[f"arm_joint{k}" for k in range(1, 8)]), action.Result.INVALID_JOINTS),
            (self.trajectory(), action.Result.INVALID_GOAL),
            (self.trajectory((1.0, q[:3])), action.Result.INVALID_GOAL),
            (self.trajectory((0.01, q + 1.0)), action.Result.INVALID_GOAL),
            (self.trajectory((2.0, q), (1.0, q)), action.Result.INVALID_GOAL),
        ]:
            status, result = self.run_goal(action, name, bad)
            self.assertEqual((status, result.error_code, bool(result.error_string)), (ABORTED, code, True))
        handle = self.client.send_goal(action, name, self.trajectory((10.0, q + 3 * move)))
        self.assertEqual(self.client.cancel(handle), 1)
        self.assertEqual(self.client.result(handle)[0], CANCELED)


class Gripper(RosCase):
    NAME = "/left_gripper/"

    def run_goal(self, kind, name, goal, feedback=None):
        handle = self.client.send_goal(kind, self.NAME + name, goal, feedback)
        self.assertTrue(handle.accepted)
        return self.client.result(handle)

    def width(self):
        return self.state("left").gripper_width

    def wait_for_field(self, field, value):
        """Waits for the state, which arrives a little after the answer on a busy machine."""
        self.wait(lambda: abs(getattr(self.states("left").newest(), field) - value) < 2e-3, f"{field} of {value}")

    def test_homing_moving_grasping(self):
        status, result = self.run_goal(Homing, "homing", Homing.Goal())
        self.assertEqual((status, result.success, result.error), (SUCCEEDED, True, ""))
        self.wait_for_field("gripper_max_width", 0.08)
        widths = []
        status, result = self.run_goal(
            Move, "move", Move.Goal(width=0.03, speed=0.05), lambda m: widths.append(m.feedback.current_width)
        )
        self.assertEqual((status, result.success), (SUCCEEDED, True))
        self.wait_for_field("gripper_width", 0.03)
        self.assertTrue(widths)
        fingers = self.topic(JointState, self.NAME + "joint_states")
        self.wait(
            lambda: fingers.newest() and np.allclose(fingers.newest().position, [0.015, 0.015], atol=1e-3),
            "fingers there",
        )
        # there is no object
        status, result = self.run_goal(Grasp, "grasp", Grasp.Goal(width=0.02, speed=0.05, force=20.0))
        self.assertEqual((status, result.success, bool(result.error)), (ABORTED, False, True))
        for bad in (
            Move.Goal(width=-0.01, speed=0.1),
            Move.Goal(width=0.02, speed=0.0),
            Move.Goal(width=0.5, speed=0.1),
            Move.Goal(width=float("nan"), speed=0.1),
        ):
            status, result = self.run_goal(Move, "move", bad)
            self.assertEqual((status, result.success, bool(result.error)), (ABORTED, False, True))

    def test_cancel_preempt_stop(self):
        self.run_goal(Move, "move", Move.Goal(width=0.07, speed=0.2))
        slow = Move.Goal(width=0.0, speed=0.005)
        handle = self.client.send_goal(Move, self.NAME + "move", slow)
        self.wait(lambda: self.states("left").newest().gripper_moving, "motion")
        self.assertEqual(self.client.cancel(handle), 1)
        self.assertEqual(self.client.result(handle)[0], CANCELED)
        self.assertGreater(self.width(), 0.02)
        first = self.client.send_goal(Move, self.NAME + "move", slow)
        second = self.client.send_goal(Move, self.NAME + "move", Move.Goal(width=0.06, speed=0.2))
        self.assertEqual((self.client.result(first)[0], self.client.result(second)[0]), (ABORTED, SUCCEEDED))
        third = self.client.send_goal(Move, self.NAME + "move", slow)
        self.wait(lambda: self.states("left").newest().gripper_moving, "motion")
        self.assertTrue(self.call(Trigger, self.NAME + "stop").success)
        self.assertEqual(self.client.result(third)[0], ABORTED)

    def test_as_moveit_drives_it(self):
        goal = GripperCommand.Goal()
        goal.command.position = 0.02
        status, result = self.run_goal(GripperCommand, "gripper_action", goal)
        self.assertEqual((status, result.reached_goal), (SUCCEEDED, True))
        self.wait_for_field("gripper_width", 0.04)
        self.assertAlmostEqual(result.position, 0.02, delta=1e-3)
