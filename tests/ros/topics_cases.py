"""Every topic: its type, its rate in the run's own time, and its content, compared with independent computations."""

import itertools
import statistics

import kinematics
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from multipanda_msgs.msg import Event, LoopStatistics, ObjectPoses, RobotModel, RobotState, Switch
from multipanda_msgs.srv import ListArms, ListControllets, ListFeatures
from ros_case import ARMS, RosCase, nanoseconds
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

FIXED = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/robot_description": "std_msgs/msg/String",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/simulation/object_poses": "multipanda_msgs/msg/ObjectPoses",
    "/multipanda/markers": "visualization_msgs/msg/MarkerArray",
    "/multipanda/loop_statistics": "multipanda_msgs/msg/LoopStatistics",
    "/multipanda/events": "multipanda_msgs/msg/Event",
    "/multipanda/switch_events": "multipanda_msgs/msg/Switch",
    "/parameter_events": "rcl_interfaces/msg/ParameterEvent",
    "/multipanda/left_pose/pose": "geometry_msgs/msg/PoseStamped",
    "/multipanda/left_pose/pose/goal": "geometry_msgs/msg/PoseStamped",
    "/multipanda/left_pose/pose/reference": "geometry_msgs/msg/PoseStamped",
    "/multipanda/left_joint/joints": "sensor_msgs/msg/JointState",
    "/multipanda/right_force/wrench": "geometry_msgs/msg/WrenchStamped",
}
PER_ARM = {
    "robot_state": "multipanda_msgs/msg/RobotState",
    "model": "multipanda_msgs/msg/RobotModel",
    "wrench": "geometry_msgs/msg/WrenchStamped",
}
FRAMES = [*(f"link{i}" for i in range(9)), "hand", "hand_tcp", "leftfinger", "rightfinger"]


EXPECTED = {
    **FIXED,
    **{f"/{arm}/{name}": kind for arm in ARMS for name, kind in PER_ARM.items()},
    **{f"/{arm}_gripper/joint_states": "sensor_msgs/msg/JointState" for arm in ARMS},
}


class Topics(RosCase):
    def test_all_are_there_with_their_types(self):
        expected = EXPECTED
        found = dict(self.client.node.get_topic_names_and_types())
        self.assertEqual(
            {name: found.get(name) for name in expected}, {name: [kind] for name, kind in expected.items()}
        )

    def test_rates_in_the_runs_own_time(self):
        # A topic of rate r is published every round(1000 / r)-th cycle of 1 ms of the run's own time: stamps are that
        # far apart, to the nanosecond. If the machine delays the publisher or this client, messages are left out, and a
        # message whose cycle was left out comes with the next one. So the test checks what holds everywhere: ten
        # messages in a row come without a gap once, the most frequent step is this one, and there are never more
        # messages than due cycles.
        topics = {
            self.topic(kind, name): round(1000 / rate) * 1_000_000
            for kind, name, rate in [
                (JointState, "/joint_states", 100),
                (RobotState, "/left/robot_state", 100),
                (RobotModel, "/right/model", 50),
                (WrenchStamped, "/left/wrench", 100),
                (PoseStamped, "/multipanda/left_pose/pose/reference", 100),
                (ObjectPoses, "/simulation/object_poses", 30),
                (JointState, "/left_gripper/joint_states", 30),
            ]
        }

        before = {topic: topic.count for topic in topics}  # a previous test may have paused the run

        def steps_of(topic):
            fresh = topic.count - before[topic]
            return np.diff([nanoseconds(m.header.stamp) for m in list(topic.messages)[-fresh:]] if fresh > 0 else [])

        def gapless(topic, gap):
            right = "".join("x" if step == gap else "." for step in steps_of(topic))
            return "x" * 10 in right

        for topic, gap in topics.items():
            topic.next(20)
            self.wait(lambda t=topic, w=gap: gapless(t, w), f"ten messages of {topic.name} {gap * 1e-6:g} ms apart")
            steps = steps_of(topic)
            self.assertEqual(statistics.mode(steps), gap, (topic.name, steps))
            self.assertTrue(all(step > 0 and step % 1_000_000 == 0 for step in steps), (topic.name, steps))
            self.assertGreater(sum(steps), (len(steps) - 1) * gap, (topic.name, steps))
        # At 1 kHz a Python reader cannot keep up and must not block the publisher: best effort, as the
        # documentation advises.
        clock = self.topic(Clock, "/clock", best_effort=True)
        clock.next(100)
        steps = np.diff([nanoseconds(m.clock) for m in list(clock.messages)[-100:]])
        self.assertTrue(all(step > 0 and step % 1_000_000 == 0 for step in steps), steps)
        self.client.forget(*topics, clock)

    def test_joint_states_and_frames_agree_with_the_description(self):
        robot = self.robot()
        joint_states, tf = self.topic(JointState, "/joint_states"), self.topic(TFMessage, "/tf")
        fixed = self.topic(TFMessage, "/tf_static", latched=True)
        self.wait(fixed.newest, "fixed frames")
        tf.next(20)

        def both():  # with equal stamps: all transforms of a time are in one message
            positions = {nanoseconds(m.header.stamp): m for m in list(joint_states.messages)}
            return next(
                (
                    (positions[t], m)
                    for m in reversed(list(tf.messages))
                    if (t := nanoseconds(m.transforms[0].header.stamp)) in positions
                ),
                None,
            )

        joints, moving = self.wait(both, "joints and frames of one time")
        names = [
            f"{arm}_{name}"
            for arm in ARMS
            for name in [*(f"joint{i}" for i in range(1, 8)), "finger_joint1", "finger_joint2"]
        ]
        self.assertEqual(list(joints.name), names)
        q = dict(zip(joints.name, joints.position))
        parents = {t.child_frame_id: t for t in itertools.chain(moving.transforms, fixed.newest().transforms)}
        self.assertEqual(
            len(parents), len(moving.transforms) + len(fixed.newest().transforms), "a frame has two parents"
        )

        def in_world(frame):
            X = np.eye(4)
            while frame != "world":
                X, frame = kinematics.of_transform(parents[frame]) @ X, parents[frame].header.frame_id
            return X

        for arm in ARMS:
            for frame in FRAMES:
                np.testing.assert_allclose(
                    in_world(f"{arm}_{frame}"), robot.link(f"{arm}_{frame}", q), atol=1e-6, err_msg=f"{arm}_{frame}"
                )
            np.testing.assert_allclose(in_world(f"{arm}_ee"), in_world(f"{arm}_hand_tcp"), atol=1e-9)  # the default
            np.testing.assert_allclose(in_world(f"{arm}_k"), in_world(f"{arm}_ee"), atol=1e-9)

    def test_robot_state_and_model_agree_with_the_description(self):
        robot = self.robot()
        goal = self.client.publisher(PoseStamped, "/multipanda/left_pose/pose/goal")
        target = PoseStamped()
        target.pose = self.state("left").pose
        target.pose.position.z -= 0.1
        states, models = self.states("left"), self.topic(RobotModel, "/left/model")
        goal.publish(target)

        def both():  # of one cycle, while the arm moves
            by_cycle = {m.cycle: m for m in list(states.messages)}
            return next(
                (
                    (by_cycle[m.cycle], m)
                    for m in reversed(list(models.messages))
                    if m.cycle in by_cycle and np.linalg.norm(by_cycle[m.cycle].dq) > 0.03
                ),
                None,
            )

        state, model = self.wait(both, "state and model of one cycle of a moving arm")
        n = 7
        q, dq = np.array(state.q), np.array(state.dq)
        self.assertEqual(list(state.joint_names), [f"left_joint{i}" for i in range(1, 8)])

        def pose(positions):
            return robot.link("left_hand_tcp", {f"left_joint{i + 1}": x for i, x in enumerate(positions)})

        np.testing.assert_allclose(kinematics.of_pose(state.pose), pose(q), atol=1e-6)
        np.testing.assert_allclose(kinematics.of_pose(model.pose), pose(q), atol=1e-6)
        J = np.array(model.jacobian).reshape(6, n)
        for k in range(n):  # columns from differences of the description's kinematics
            step = np.eye(n)[k] * 1e-6
            up, down = pose(q + step), pose(q - step)
            turn = (up[:3, :3] @ down[:3, :3].T - np.eye(3)) / 2e-6
            column = [*((up - down)[:3, 3] / 2e-6), turn[2, 1], turn[0, 2], turn[1, 0]]
            np.testing.assert_allclose(J[:, k], column, atol=1e-5)
        twist = [getattr(getattr(state.twist, part), axis) for part in ("linear", "angular") for axis in "xyz"]
        np.testing.assert_allclose(J @ dq, twist, atol=1e-9)
        M = np.array(model.mass).reshape(n, n)
        np.testing.assert_allclose(M, M.T, atol=1e-12)
        self.assertGreater(np.linalg.eigvalsh(M)[0], 0)
        self.assertAlmostEqual(model.manipulability, np.sqrt(np.linalg.det(J @ J.T)), places=9)
        # tau_j is measured with gravity, commands are without it: at this small acceleration they agree roughly
        np.testing.assert_allclose(np.array(state.tau_j) - model.gravity, state.tau_cmd, atol=2.0)
        self.assertEqual(
            (state.arm, state.owner, state.mode, state.errors, state.stopped, state.due),
            ("left", "left_pose", RobotState.MODE_MOVE, 0, False, True),
        )
        np.testing.assert_allclose(np.array(state.tau_controllet) + state.tau_feature, state.tau_cmd, atol=1e-9)
        self.assertTrue(state.has_gripper)
        self.at("left", kinematics.of_pose(target.pose)[:3, 3])
        back = target
        back.pose.position.z += 0.1
        goal.publish(back)
        self.at("left", kinematics.of_pose(back.pose)[:3, 3])

    def test_outputs_and_set_points_of_active_controllets_only(self):
        infos = {info.name: info for info in self.call(ListControllets, "/multipanda/list_controllets").controllets}
        kinds = {"std_msgs/msg/Float64": Float64, "std_msgs/msg/Float64MultiArray": Float64MultiArray}
        off = {
            f.name
            for f in self.call(ListFeatures, "/multipanda/list_features", instance="left_pose").features
            if not f.on
        }

        def is_published(output):  # ~/left_pose/OUTPUT, ~/left_pose/FEATURE/OUTPUT
            return output.topic.split("/")[3] not in off

        outputs = infos["left_pose"].outputs
        active = {o.topic: (self.topic(kinds[o.type], o.topic), o.size) for o in outputs if is_published(o)}
        asleep = [
            self.topic(kinds[o.type], o.topic)
            for o in [*infos["left_joint"].outputs, *(o for o in outputs if not is_published(o))]
        ]
        self.assertTrue(active and off and len(asleep) > len(infos["left_joint"].outputs))
        for topic, size in active.values():
            topic.next(5)
            if size > 1:
                self.assertEqual(len(topic.newest().data), size, topic.name)
        self.assertEqual([topic.count for topic in asleep], [0] * len(asleep))
        reference = self.topic(PoseStamped, "/multipanda/left_pose/pose/reference")
        reference.next(2)
        self.assertEqual(reference.newest().header.frame_id, "world")
        distance = kinematics.of_pose(reference.newest().pose)[:3, 3] - self.position("left")
        self.assertLess(np.linalg.norm(distance), 0.01)
        self.client.forget(*(t for t, _ in active.values()), *asleep)

    def test_wrench_where_there_is_an_estimate(self):
        for arm in self.call(ListArms, "/multipanda/list_arms").arms:
            self.assertTrue(arm.simulated)
            self.assertTrue(self.state(arm.name).has_wrench)  # by the momentum observer
            message = self.topic(WrenchStamped, f"/{arm.name}/wrench").next(3)
            self.assertEqual(message.header.frame_id, "world")
            force = message.wrench.force  # nothing touches the arm
            self.assertLess(np.linalg.norm([force.x, force.y, force.z]), 5.0)

    def test_objects(self):
        message = self.topic(ObjectPoses, "/simulation/object_poses").next(2)
        self.assertEqual((list(message.names), message.header.frame_id), (["box"], "world"))
        np.testing.assert_allclose(kinematics.of_pose(message.poses[0])[:3, 3], [-0.6, 0, 0.33], atol=2e-3)  # at rest

    def test_markers(self):
        topic = self.topic(MarkerArray, "/multipanda/markers")
        message = topic.next(3)
        self.client.forget(topic)  # large messages take Python's time from the other tests
        markers = {(m.ns, m.id): m for m in message.markers}
        self.assertEqual(len(markers), len(message.markers))
        self.assertEqual({m.header.frame_id for m in message.markers}, {"world"})

        def position(key):
            self.assertEqual(markers[key].action, Marker.ADD, key)
            return kinematics.of_pose(markers[key].pose)[:3, 3]

        np.testing.assert_allclose(position(("objects", 1)), [-0.6, 0, 0.15], atol=1e-9)
        np.testing.assert_allclose(position(("objects", 2)), [-0.6, 0, 0.33], atol=2e-3)  # at rest
        # Targets are numbered as the controllets of the scene; the poses are the third and fourth.
        for arm, number in (("left", 2), ("right", 3)):
            reference = self.topic(PoseStamped, f"/multipanda/{arm}_pose/pose/reference").next(2)
            np.testing.assert_allclose(
                position(("targets", number)), kinematics.of_pose(reference.pose)[:3, 3], atol=2e-3
            )
        self.assertEqual(markers["targets", 0].action, Marker.DELETE)  # left_joint is not active

    def test_statistics_diagnostics_and_events(self):
        before, after = self.statistics(), self.statistics()
        self.assertIsInstance(after, LoopStatistics)
        for low, middle, high in (
            (after.cycle_time_median, after.cycle_time_p99, after.cycle_time_worst),
            (after.period_median, after.period_p99, after.period_worst),
        ):
            self.assertTrue(0 < low <= middle <= high)
        self.assertGreater(after.messages_published, before.messages_published)
        self.assertAlmostEqual(after.rate * after.window, after.cycles, delta=0.2 * after.cycles)
        # A message fails if a middleware thread without a core is still sending all places of the topic's history,
        # which is rare; a writer that is set up wrongly fails at nearly every message.
        self.assertLessEqual(after.publish_failures, 0.01 * after.messages_published)
        status = self.topic(DiagnosticArray, "/diagnostics").next().status
        names = " ".join(s.name for s in status)
        for word in ("loop", *ARMS):
            self.assertIn(word, names)
        switches = self.topic(Switch, "/multipanda/switch_events", latched=True)
        count = switches.count
        self.switched("left_guide")
        self.wait(lambda: switches.count > count, "a switch event")
        switch = switches.wait(lambda m: list(m.started) == ["left_guide"], "the switch")
        self.assertTrue(switch.accepted)
        self.assertEqual((list(switch.stopped), list(switch.arms)), (["left_pose"], ["left"]))
        self.topic(Event, "/multipanda/events", latched=True)
