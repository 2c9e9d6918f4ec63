"""Motion generators as separate nodes: generators_test.py PROGRAM.

Two hands around obstacles, and via points, by topics.
"""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import ros_run

PROGRAM = sys.argv.pop(1) if len(sys.argv) > 1 else ""
try:
    import multipanda_msgs.msg  # noqa: F401
    import rclpy  # noqa: F401
except ImportError as missing:
    print(f"skipped: this Python has no ROS interfaces of this build: {missing}")
    sys.exit(77)

from geometry_msgs.msg import PoseStamped
from multipanda_msgs.msg import RobotState
from multipanda_msgs.srv import SwitchControllets

# Generous timeouts, since a publisher may have to wait on a busy machine.
SCENE = """\
name: generators_test
arms:
  - {name: left, start_rad: ready, base: {position_m: [0, 0.26, 0]}}
  - {name: right, start_rad: ready, base: {position_m: [0, -0.26, 0]}}
controllets:
  - {name: dual, type: dual_cartesian_impedance, arms: [left, right],
     parameters: {goals: separate, acceleration_feedforward: false},
     inputs: {first_pose: {timeout_s: 1}, second_pose: {timeout_s: 1}, common_pose: {timeout_s: 1}}}
  - {name: joints, type: joint_impedance, arms: left, inputs: {joints: {timeout_s: 1}}}
  - {name: pose, type: cartesian_impedance, arms: right, inputs: {pose: {timeout_s: 1}}}
active: [dual]
"""
VIA = """\
name: both
limits: {velocity_rad_per_s: 0.4, speed_m_per_s: 0.2}
tracks:
  - arm: left
    joints_rad: [[0.1, -0.8, 0, -2.3, 0, 1.5, 0.8], [0, -0.7, 0.1, -2.2, 0, 1.6, 0.7]]
    publish: [{controllet: joints, input: joints}]
  - arm: right
    poses:
      - {position_m: [0.4, -0.2, 0.5], rpy_rad: [pi, 0, 0]}
      - {position_m: [0.45, -0.25, 0.45], rpy_rad: [pi, 0, 0.3]}
    publish: [{controllet: pose, input: pose}]
"""


class Generators(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.scene, cls.via = (pathlib.Path(cls.folder.name, name) for name in ("scene.yaml", "via.yaml"))
        cls.scene.write_text(SCENE, encoding="utf-8")
        cls.via.write_text(VIA, encoding="utf-8")
        cls.domain = ros_run.own_domain(2)
        cls.run_ = ros_run.Run(PROGRAM, cls.scene, "--seconds", "250", domain=cls.domain).__enter__()
        cls.addClassCleanup(cls.run_.end)
        cls.client = ros_run.Client(cls.domain)
        cls.addClassCleanup(cls.client.close)
        for arm in ("left", "right"):
            cls.client.topic(RobotState, f"/{arm}/robot_state", best_effort=True).next(timeout=30)

    def start(self, *arguments):
        return subprocess.Popen(
            [PROGRAM, *map(str, arguments), "--ros", "--json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=ros_run.environment(self.domain),
        )

    def finish(self, process, code=0):
        output, errors = process.communicate(timeout=90)
        self.assertEqual(process.returncode, code, (output, errors))
        return (json.loads(output) if code == 0 else None), errors

    def generate(self, *arguments, code=0):
        return self.finish(self.start(*arguments), code)

    def state(self, arm):
        return self.client.topic(RobotState, f"/{arm}/robot_state", best_effort=True).next()

    def switch(self, *names):
        answer = self.client.call(SwitchControllets, "/multipanda/switch_controllets", activate=list(names))
        self.assertTrue(answer.accepted, answer.reason)

    def test_1_refusals_list_the_valid_names(self):
        course = "generate", "circular-field", "two_hands"
        self.assertIn("dual", self.generate(*course, "--to", "left=duel.first_pose", code=2)[1])
        self.assertIn("first_pose", self.generate(*course, "--to", "left=dual.first_pos", code=2)[1])
        self.assertIn("takes joints, not pose", self.generate(*course, "--to", "left=joints.joints", code=2)[1])
        self.assertIn("--ros", self.generate(*course, "--node", "/nobody", code=1)[1])
        other = pathlib.Path(self.folder.name, "other.yaml")
        other.write_text(VIA.replace("arm: left", "arm: lefd"), encoding="utf-8")
        self.assertIn("left", self.generate("via-points", other, code=2)[1])

    def test_2_two_hands_at_once(self):
        self.switch("dual")
        before = {arm: self.state(arm).pose.position for arm in ("left", "right")}
        heard = [
            self.client.topic(PoseStamped, f"/multipanda/dual/{name}_pose", best_effort=True)
            for name in ("first", "second")
        ]
        report, _ = self.generate("generate", "circular-field", "two_hands", "--seconds", "4")
        print(json.dumps(report))
        self.assertEqual(report["ended_by"], "duration")
        self.assertGreaterEqual(report["samples"] + report["missed"], 4000)
        self.assertGreaterEqual(report["clearance_m"], 0.02)
        self.assertEqual(
            [c["topic"] for c in report["channels"]], ["/multipanda/dual/first_pose", "/multipanda/dual/second_pose"]
        )
        for channel in report["channels"]:
            self.assertEqual(
                (channel["sent"], channel["failed"], channel["refused"]), (report["samples"], 0, 0), channel
            )
            self.assertGreater(channel["received"], 0.3 * channel["sent"], channel)  # the run reads the newest
        for topic in heard:
            self.assertGreater(topic.count, 100)
            self.assertEqual(topic.newest().header.frame_id, "world")
        # The publisher has ended. Its last pose is a goal, so the controllet still runs after the timeout.
        time.sleep(1.5)
        for arm, position in before.items():
            now = self.state(arm)
            self.assertEqual(now.owner, "dual")
            moved = sum((getattr(now.pose.position, k) - getattr(position, k)) ** 2 for k in "xyz") ** 0.5
            self.assertGreater(moved, 0.05, arm)

    def test_3_ends_in_order_when_asked(self):
        self.switch("dual")
        poses = self.client.topic(PoseStamped, "/multipanda/dual/first_pose", best_effort=True)
        process, before = self.start("generate", "circular-field", "two_hands"), poses.count
        ros_run.wait_for(lambda: poses.count > before + 50, "poses", 20)
        process.send_signal(signal.SIGINT)
        self.assertEqual(self.finish(process)[0]["ended_by"], "stopped")

    def test_4_via_points_of_joints_and_poses(self):
        self.switch("joints", "pose")
        report, _ = self.generate("via-points", self.via)
        print(json.dumps(report))
        self.assertEqual(report["ended_by"], "goals")
        self.assertEqual([t["passed"] for t in report["tracks"]], [2, 2])
        self.assertAlmostEqual(report["samples"] + report["missed"], 1000 * report["duration_s"], delta=2)
        goal = [0, -0.7, 0.1, -2.2, 0, 1.6, 0.7]

        def there():
            left, right = self.state("left"), self.state("right").pose.position
            return (
                max(abs(a - b) for a, b in zip(left.q, goal)) < 0.02
                and abs(right.x - 0.45) < 0.01
                and abs(right.y + 0.25) < 0.01
                and abs(right.z - 0.45) < 0.01
            )

        ros_run.wait_for(there, "both arms at their last via points", 10)
        time.sleep(1.5)  # longer than the timeout of the inputs
        self.assertEqual((self.state("left").owner, self.state("right").owner), ("joints", "pose"))

    def test_5_an_inactive_controllet_refuses_samples(self):
        self.switch("dual")
        process = self.start("via-points", self.via, "--seconds", "1")
        output, errors = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 1, (output, errors))
        self.assertIn("refused", errors)

    def test_6_nothing_was_interfered_with(self):
        self.assertEqual(self.run_.end(), 0)
        # Ending stops the arms. On a busy machine streams are uneven and their torques may reach the rate limit.
        rules = {i["rule"] for i in self.run_.summary["interventions"]} - {"stop_requested", "torque_rate_clamped"}
        self.assertEqual(rules, set(), self.run_.summary["interventions"])


if __name__ == "__main__":
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    unittest.main()
