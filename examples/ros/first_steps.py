#!/usr/bin/env python3
"""First steps with multipanda over ROS 2: read an arm's state, switch its controllet, send it to a goal.

    ./multipanda run examples/ros/scene.yaml --ros &
    .venv/bin/python examples/ros/first_steps.py

Needs only rclpy and the message packages; with a ROS 2 installation, any Python that has them works.
"""

import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped
from multipanda_msgs.msg import RobotState
from multipanda_msgs.srv import SwitchControllets
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy


def until(node, done, what, seconds=20.0):
    """Spins until done() is true."""
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            sys.exit(
                f"first_steps: waited {seconds:g} s for {what}; "
                "is `./multipanda run examples/ros/scene.yaml --ros` running?"
            )
        rclpy.spin_once(node, timeout_sec=0.05)


def main():
    rclpy.init()
    node = Node("first_steps")

    # 1. A topic: the left arm's complete state, 100 times a second.
    states = []
    node.create_subscription(RobotState, "left/robot_state", states.append, 10)
    until(node, lambda: states, "left/robot_state")
    at = states[-1].pose.position
    print(f"left hand at ({at.x:.3f}, {at.y:.3f}, {at.z:.3f}) m, owner {states[-1].owner}")

    # 2. A service: Cartesian impedance takes over the arm, between two control cycles.
    switch = node.create_client(SwitchControllets, "/multipanda/switch_controllets")
    until(node, switch.service_is_ready, "the service switch_controllets")
    answer = switch.call_async(SwitchControllets.Request(activate=["left_cartesian"]))
    until(node, answer.done, "the answer")
    result = answer.result()
    if not result.accepted:
        sys.exit(f"first_steps: refused: {result.reason}")
    print(
        f"switched: {result.started} instead of {result.stopped}; first torque {1e3 * result.total_s:.2f} ms after the "
        f"request, step {max(result.torque_step, default=0.0):.2f} N m"
    )

    # 3. A goal: 10 cm higher, approached smoothly from any distance, and kept.
    goals = node.create_publisher(
        PoseStamped,
        "/multipanda/left_cartesian/pose/goal",
        QoSProfile(depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.VOLATILE),
    )
    until(node, lambda: goals.get_subscription_count() > 0, "the input's topic")
    until(node, lambda: states[-1].owner == "left_cartesian", "the new owner in robot_state")
    goal = PoseStamped(pose=states[-1].pose)  # no frame_id: the input's own, here the world
    goal.pose.position.z += 0.1
    goals.publish(goal)

    def distance():
        p, q = states[-1].pose.position, goal.pose.position
        return ((p.x - q.x) ** 2 + (p.y - q.y) ** 2 + (p.z - q.z) ** 2) ** 0.5

    until(node, lambda: distance() < 0.002, "the arm to arrive")
    print(f"arrived, {1e3 * distance():.1f} mm from the goal")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
