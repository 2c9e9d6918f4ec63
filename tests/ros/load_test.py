"""Runs everything at 1 kHz, and the same run without ROS: load_test.py PROGRAM. Prints the load of both.

10 s each, 60 s with MULTIPANDA_FULL=1. Two arms publish their complete state at 1 kHz, and a client sends targets to
both at 1 kHz.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
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
from multipanda_msgs.msg import LoopStatistics, RobotState

SECONDS = 60 if os.environ.get("MULTIPANDA_FULL") == "1" else 10
ARMS = ("left", "right")


class Streams(threading.Thread):
    """Sends poses to both arms at 1 kHz from its own thread, as a user's planner does."""

    def __init__(self, client, poses):
        super().__init__(daemon=True)
        self.publishers = [
            (client.publisher(PoseStamped, f"/multipanda/{arm}_pose/pose", best_effort=True), pose)
            for arm, pose in poses.items()
        ]
        self.sent, self.over = 0, threading.Event()
        self.start()

    def run(self):
        due = time.monotonic()
        while not self.over.is_set():
            for publisher, pose in self.publishers:
                publisher.publish(pose)
            self.sent += 1
            due = max(due + 0.001, time.monotonic() - 0.01)  # missed periods are skipped
            time.sleep(max(0.0, due - time.monotonic()))


class Load(unittest.TestCase):
    def plain(self, scene):
        with ros_run.Run(PROGRAM, scene, "--seconds", str(SECONDS), ros=False) as run:
            run.process.wait(SECONDS + 60)
            self.assertEqual(run.end(), 0, "".join(run.output)[-2000:])
        return run.summary

    def with_ros(self, scene):
        domain = ros_run.own_domain(1)
        with ros_run.Run(PROGRAM, scene, "--seconds", str(SECONDS + 30), domain=domain) as run:
            client = ros_run.Client(domain, "load")
            try:
                statistics = client.topic(LoopStatistics, "/multipanda/loop_statistics")
                states = {arm: client.topic(RobotState, f"/{arm}/robot_state", keep=5) for arm in ARMS}
                poses = {}
                for arm, topic in states.items():
                    poses[arm] = PoseStamped(pose=topic.next(1).pose)
                    poses[arm].header.frame_id = "world"
                client.forget(states["right"])  # one reader at 1 kHz is enough for Python
                # Every topic has a reader, since topics without one are not published.
                listener = subprocess.Popen(
                    [pathlib.Path(PROGRAM).parent / "benchmarks/ros_listener", str(SECONDS + 4)],
                    env={**os.environ, **ros_run.environment(domain)},
                    stdout=subprocess.PIPE,
                    text=True,
                )
                statistics.next(20)
                streams = Streams(client, poses)
                begin = statistics.next(2)
                sent, taken, started = streams.sent, states["left"].count, time.monotonic()
                end = statistics.wait(
                    lambda m: m.cycle - begin.cycle >= SECONDS * 1000, "the end", timeout=3 * SECONDS + 30
                )
                elapsed = time.monotonic() - started
                sent, taken = streams.sent - sent, states["left"].count - taken
                owner = states["left"].newest().owner
                streams.over.set()
                streams.join(5)
                received = json.loads(listener.communicate(timeout=SECONDS + 60)[0])
            finally:
                client.close()
            self.assertEqual(run.end(), 0, "".join(run.output)[-2000:])
        for arm in ARMS:
            print(f"received {arm}: {received[f'/{arm}/robot_state']}", file=sys.stderr)
        return begin, end, {"sent": sent, "sent_hz": sent / elapsed, "taken_hz": taken / elapsed, "owner": owner}

    def test_one_kilohertz_compared_with_a_run_without_ros(self):
        with tempfile.TemporaryDirectory() as folder:
            text = (pathlib.Path(__file__).parent / "scene.yaml").read_text()
            scene = pathlib.Path(folder, "load.yaml")
            scene.write_text(
                text.replace("robot_state: 100, joint_states: 100", "robot_state: 1000, joint_states: 1000")
            )
            before = self.plain(scene)
            begin, end, client = self.with_ros(scene)
            after = self.plain(scene)
        cycles, overruns = end.cycle - begin.cycle, end.overruns - begin.overruns
        messages, failed = (
            end.messages_published - begin.messages_published,
            end.publish_failures - begin.publish_failures,
        )
        dropped, accepted = end.records_dropped - begin.records_dropped, end.samples_accepted - begin.samples_accepted
        plain = [run["overruns"] / run["cycles"] for run in (before, after)]
        print(
            f"{SECONDS} s, two arms: overruns per cycle {overruns / cycles:.4f} with ROS, {plain[0]:.4f} before and "
            f"{plain[1]:.4f} after without; cycle time median {end.cycle_time_median * 1e6:.0f} us with, "
            f"{before['cycle_us']['median']:.0f} and {after['cycle_us']['median']:.0f} us without; "
            f"{messages / cycles:.2f} messages per cycle, {failed} failed, {dropped} of {cycles} cycles dropped; "
            f"client: sent {client['sent_hz']:.0f} Hz to each arm, received {client['taken_hz']:.0f} Hz",
            file=sys.stderr,
        )
        self.assertEqual(client["owner"], "left_pose")  # the streams never fell silent
        self.assertEqual(end.samples_refused, begin.samples_refused)
        # The machine decides how many messages the publisher's and the middleware's threads can send, but every missing
        # one must be counted: two states and joint_states each cycle. A second's worth may be under way at either end.
        self.assertGreaterEqual(messages + failed, 3 * (cycles - dropped - 1000))
        self.assertGreater(messages, cycles)  # this many arrived on cores shared with nine other programs
        # The run reads the newest message of each arm's stream, at least every fifth of those sent.
        self.assertGreater(accepted, 0.2 * min(cycles, 2 * client["sent"]))
        # A shared machine has occasional delays of its own; the spread of the two runs without ROS shows them.
        self.assertLess(overruns / cycles, 3 * max(plain) + 0.05)


if __name__ == "__main__":
    unittest.main()
