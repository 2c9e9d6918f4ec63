"""Set-points from topics: followed, transformed between frames, and refused or held if wrong, too many or missing."""

import time

import kinematics
import numpy as np
import ros_run
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from multipanda_msgs.msg import Intervention
from ros_case import RosCase
from sensor_msgs.msg import JointState

POSE = "/multipanda/left_pose/pose"


def pose_like(pose, frame_id="world", **shift):
    message = PoseStamped()
    message.header.frame_id = frame_id
    message.pose.orientation = pose.orientation
    for axis in "xyz":
        setattr(message.pose.position, axis, getattr(pose.position, axis) + shift.get(axis, 0.0))
    return message


class Inputs(RosCase):
    def setUp(self):
        super().setUp()
        self.start = self.state("left").pose
        self.here = kinematics.of_pose(self.start)[:3, 3]

    def stream(self, publisher, messages, period=0.01):
        """Yields a steady series: each item is due one period after the previous one, however long that took."""
        due = time.monotonic()
        for message in messages:
            publisher.publish(message)
            due += period
            time.sleep(max(0.0, due - time.monotonic()))

    def refusals(self, publish, count):
        """Returns how many more messages the run refuses after a call of `publish`."""
        before = self.statistics().samples_refused
        publish()
        statistics = self.topic_of_statistics()
        return self.wait(
            lambda: (
                statistics.newest().samples_refused - before >= count and statistics.newest().samples_refused - before
            ),
            f"{count} refused messages",
        )

    def topic_of_statistics(self):
        from multipanda_msgs.msg import LoopStatistics

        return self.topic(LoopStatistics, "/multipanda/loop_statistics")

    def diagnosis(self, name):
        def newest():
            message = self.topic(DiagnosticArray, "/diagnostics").newest()
            return next((s for s in message.status if name in s.name), None) if message else None

        self.topic(DiagnosticArray, "/diagnostics").next(2)
        return newest()

    def test_a_goal_is_approached_in_any_frame(self):
        goal = self.client.publisher(PoseStamped, POSE + "/goal")
        goal.publish(pose_like(self.start, z=0.04))
        self.at("left", self.here + [0, 0, 0.04])
        X_BE = np.linalg.inv(self.base("left")) @ kinematics.of_pose(self.state("left").pose)
        message = pose_like(self.start, "left_link0")
        message.pose.position.x, message.pose.position.y, message.pose.position.z = (
            float(v) for v in X_BE[:3, 3] + [0.03, 0, -0.04]
        )
        yaw = 0.4  # of the base: rotate the orientation back by it
        q = self.start.orientation
        c, s = np.cos(yaw / 2), -np.sin(yaw / 2)
        turned = (c * q.w - s * q.z, c * q.x - s * q.y, c * q.y + s * q.x, c * q.z + s * q.w)
        (
            message.pose.orientation.w,
            message.pose.orientation.x,
            message.pose.orientation.y,
            message.pose.orientation.z,
        ) = (float(v) for v in turned)
        goal.publish(message)
        ahead = self.base("left")[:3, :3] @ [0.03, 0, 0]
        self.at("left", self.here + ahead)
        goal.publish(pose_like(self.start, ""))  # its own frame
        self.at("left", self.here)

    def test_a_stream_is_followed_until_its_publisher_dies(self):
        publisher = self.client.publisher(PoseStamped, POSE)
        along = [pose_like(self.start, y=-0.05 * 0.5 * (1 - np.cos(np.pi * k / 100))) for k in range(101)]
        self.stream(publisher, along + [along[-1]] * 30)
        np.testing.assert_allclose(self.position("left"), self.here + [0, -0.05, 0], atol=4e-3)
        # Silence: the arm is held and the run reports it; the other arm continues.
        self.wait(lambda: self.states("left").newest().owner == "left_hold", "the arm being held")
        self.assertEqual(self.state("right").owner, "right_pose")
        self.assertGreater(self.state("left").interventions, 0)
        self.assertTrue(self.run_.alive())
        self.switched("left_pose")
        goal = self.client.publisher(PoseStamped, POSE + "/goal")
        goal.publish(pose_like(self.start))
        self.at("left", self.here)

    def test_joints_by_name_in_any_order(self):
        self.switched("left_joint")
        publisher = self.client.publisher(JointState, "/multipanda/left_joint/joints/goal")
        q = np.array(self.state("left").q)
        order = [3, 0, 6, 1, 2, 5, 4]
        target = q + np.array([0.05, 0, 0, -0.05, 0, 0, 0.1])
        publisher.publish(
            JointState(name=[f"left_joint{k + 1}" for k in order], position=[float(target[k]) for k in order])
        )
        self.wait(lambda: np.max(np.abs(np.array(self.states("left").newest().q) - target)) < 5e-3, "the joints there")
        wrong = [
            JointState(name=["left_joint1"], position=[0.0]),
            JointState(position=[0.0] * 6),
            JointState(position=[9.0] + [0.0] * 6),
            JointState(name=[f"left_joint{k}" for k in range(2, 9)], position=[0.0] * 7),
            JointState(name=["left_joint1"] * 7, position=[0.0] * 7),
            JointState(position=[float("nan")] * 7),
        ]
        self.assertGreaterEqual(self.refusals(lambda: [publisher.publish(m) for m in wrong], len(wrong)), len(wrong))
        np.testing.assert_allclose(self.state("left").q, target, atol=5e-3)

    def test_a_wrench_reaches_a_force_controllet(self):
        self.switched("right_force")
        goal = self.client.publisher(WrenchStamped, "/multipanda/right_force/wrench/goal")
        reference = self.topic(WrenchStamped, "/multipanda/right_force/wrench/reference")
        message = WrenchStamped()
        message.header.frame_id = "right_link0"
        message.wrench.force.x = 1.5
        goal.publish(message)
        expected = self.base("right")[:3, :3] @ [1.5, 0, 0]

        def there():
            force = reference.newest().wrench.force if reference.newest() else None
            return force and np.linalg.norm(np.array([force.x, force.y, force.z]) - expected) < 1e-6

        self.wait(there, "the wrench in world axes")
        self.switched("right_pose")

    def test_wrong_poses_are_refused_and_reported(self):
        goal, stream = self.client.publisher(PoseStamped, POSE + "/goal"), self.client.publisher(PoseStamped, POSE)
        wrong = [
            pose_like(self.start, "moon"),
            pose_like(self.start, x=float("nan")),
            pose_like(self.start, x=float("inf")),
            pose_like(self.start, "x" * 4000),
            pose_like(self.start),
        ]
        wrong[-1].pose.orientation.w = 3.0
        self.assertGreaterEqual(self.refusals(lambda: [goal.publish(m) for m in wrong], len(wrong)), len(wrong))
        self.assertEqual(self.state("left").owner, "left_pose")
        np.testing.assert_allclose(self.position("left"), self.here, atol=3e-3)
        self.refusals(lambda: [stream.publish(wrong[1]) for _ in range(20)], 1)  # only the newest counts in a stream
        line = self.diagnosis("left_pose/pose")
        self.assertIn("not finite", line.message)
        self.assertEqual(self.state("left").owner, "left_pose")
        asleep = self.client.publisher(WrenchStamped, "/multipanda/right_force/wrench/goal")
        self.refusals(lambda: asleep.publish(WrenchStamped()), 1)  # of a controllet that does not run

    def test_wrong_types_do_not_reach_it(self):
        other = ros_run.Client(ros_run.own_domain(), "wrong")  # one participant uses one type per topic
        self.addCleanup(other.close)
        publisher = other.node.create_publisher(TwistStamped, POSE, 10)
        self.wait(lambda: other.node.count_subscribers(POSE) > 0, "the input in the graph")
        before = self.statistics()
        for _ in range(50):
            publisher.publish(TwistStamped())
        after = self.statistics()
        self.assertEqual((publisher.get_subscription_count(), after.samples_refused), (0, before.samples_refused))
        self.assertEqual(self.state("left").owner, "left_pose")

    def test_floods_of_requests(self):
        publisher = self.client.publisher(PoseStamped, POSE)
        goal = self.client.publisher(PoseStamped, POSE + "/goal")
        here, bad = pose_like(self.start), pose_like(self.start, x=float("nan"))
        before = self.state("left")
        sent, end = 0, time.monotonic() + 1.5
        while time.monotonic() < end:
            for message in (here, bad):
                publisher.publish(message)
                goal.publish(message)
                sent += 2
        publisher.publish(here)
        after = self.state("left")
        self.assertGreater(sent, 500)
        self.assertGreater(after.cycle - before.cycle, 300)  # the loop continued
        self.assertTrue(self.switch("left_guide").accepted)  # and answers
        np.testing.assert_allclose(kinematics.of_pose(after.pose)[:3, 3], self.here, atol=5e-3)
        self.assertIsNotNone(Intervention)
