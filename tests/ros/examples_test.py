"""Runs the example of the documentation as a user does, also with names in a namespace: examples_test.py PROGRAM."""

import re
import signal
import subprocess
import sys
import unittest

import ros_run

PROGRAM = sys.argv.pop(1) if len(sys.argv) > 1 else ""
try:
    import multipanda_msgs.msg  # noqa: F401
    import rclpy  # noqa: F401
except ImportError as missing:
    print(f"skipped: this Python has no ROS interfaces of this build: {missing}")
    sys.exit(77)

SCENE = ros_run.ROOT / "examples/ros/scene.yaml"

# Behind the lines of the guide: waits until the arm's set-point is the goal, and prints it.
UNTIL_THERE = """
seen = []
node.create_subscription(PoseStamped, "/multipanda/left_cartesian/pose/reference", seen.append, 10)
while not seen or abs(seen[-1].pose.position.x - 0.45) + abs(seen[-1].pose.position.z - 0.5) > 1e-6:
    rclpy.spin_once(node)
place, turn = seen[-1].pose.position, seen[-1].pose.orientation
print(seen[-1].header.frame_id, *(f"{value:.4f}" for value in (place.x, place.y, place.z, abs(turn.x))))
"""


class Examples(unittest.TestCase):
    def test_first_steps(self):
        domain = ros_run.own_domain(3)
        with ros_run.Run(PROGRAM, SCENE, "--seconds", "120", domain=domain) as run:
            steps = subprocess.run(
                [sys.executable, str(ros_run.ROOT / "examples/ros/first_steps.py")],
                capture_output=True,
                text=True,
                env=ros_run.environment(domain),
                timeout=90,
                check=False,
            )
            self.assertEqual(steps.returncode, 0, steps.stderr + "".join(run.output))
            for line in ("owner left_joint", "['left_cartesian'] instead of ['left_joint']", "arrived"):
                self.assertIn(line, steps.stdout)
            guide = (ros_run.ROOT / "docs/ros2.md").read_text(encoding="utf-8")
            lines = re.search(r"```python\n(.*?)```", guide, re.S).group(1)
            goal = subprocess.run(
                [sys.executable, "-c", lines + UNTIL_THERE],
                capture_output=True,
                text=True,
                env=ros_run.environment(domain),
                timeout=90,
                check=False,
            )
            self.assertEqual(goal.stdout.split(), ["world", "0.4500", "0.2600", "0.5000", "1.0000"], goal.stderr)
            self.assertEqual(run.end(signal.SIGTERM), 0, "".join(run.output))

    def test_two_arms(self):
        """What the page shows is what the script says, but for the numbers of cycles."""
        domain = ros_run.own_domain(5)
        script = ros_run.ROOT / "examples/ros/two_arms.py"
        with ros_run.Run(PROGRAM, "two_arms", "--no-timeline", "--seconds", "300", domain=domain) as run:
            done = subprocess.run(
                [sys.executable, script],
                capture_output=True,
                text=True,
                env=ros_run.environment(domain),
                timeout=150,
                check=False,
            )
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr + "".join(run.output))
            self.assertEqual(run.end(signal.SIGTERM), 0, "".join(run.output))
        page = (ros_run.ROOT / "docs/ros2.md").read_text()
        shown = [line.strip() for line in page.split("owners:", 1)[1].split("[The script]")[0].splitlines()]
        said = done.stdout.removeprefix("owners:").splitlines()
        plain = [re.sub(r"cycle \d+|[\d.]+ (mm|N m)", "", line.strip()) for line in said]
        self.assertEqual(plain, [re.sub(r"cycle \d+|[\d.]+ (mm|N m)", "", line) for line in shown if line])
        (apart,) = re.findall(r"changed by ([\d.]+) mm", done.stdout)
        self.assertLess(float(apart), 2)

    def test_names(self):
        domain = ros_run.own_domain(4)
        with ros_run.Run(
            PROGRAM,
            SCENE,
            "--seconds",
            "60",
            "--ros-namespace",
            "/cell",
            "--ros-node",
            "arms",
            "--ros-remap",
            "joint_states:=all_joints",
            domain=domain,
        ) as run:
            client = ros_run.Client(domain)
            try:
                ros_run.wait_for(
                    lambda: "/cell/left/robot_state" in dict(client.node.get_topic_names_and_types()),
                    "topics in the namespace",
                )

                def topics():
                    return {name for name, _ in client.node.get_topic_names_and_types()}

                ros_run.wait_for(
                    lambda: {"/cell/all_joints", "/cell/arms/events", "/tf"} <= topics(), f"the names, but {topics()}"
                )
                self.assertNotIn("/cell/joint_states", topics())
                # Names of nodes travel on a topic of their own and may arrive after those of topics.
                ros_run.wait_for(
                    lambda: ("arms", "/cell") in client.node.get_node_names_and_namespaces(), "the node's name"
                )
            finally:
                client.close()
            self.assertEqual(run.end(), 0, "".join(run.output))


if __name__ == "__main__":
    unittest.main()
