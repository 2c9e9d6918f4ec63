#!/usr/bin/env python3
"""Two arms over ROS 2: one law for both, a motion of both hands together, a feature, and a request that is refused.

    ./multipanda run two_arms --no-timeline --ros &
    .venv/bin/python examples/ros/two_arms.py

With the launch files of multipanda_bringup, give the controller's node: `two_arms.py /multimode_controller`.
"""

import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped
from multipanda_msgs.msg import RobotState
from multipanda_msgs.srv import SetFeatures, SwitchControllets
from rclpy.node import Node

ARMS = ("left", "right")


class TwoArms(Node):
    def __init__(self, controller):
        super().__init__("two_arms")
        self.controller, self.states = controller, {}
        for arm in ARMS:
            self.create_subscription(RobotState, f"/{arm}/robot_state", lambda s, arm=arm: self.keep(arm, s), 10)

    def keep(self, arm, state):
        self.states[arm] = state

    def until(self, done, what, seconds=30.0):
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() > end:
                sys.exit(f"two_arms: waited {seconds:g} s for {what}")
            rclpy.spin_once(self, timeout_sec=0.05)

    def call(self, service_type, name, **fields):
        client = self.create_client(service_type, f"{self.controller}/{name}")
        self.until(client.service_is_ready, f"the service {self.controller}/{name}")
        answer = client.call_async(service_type.Request(**fields))
        self.until(answer.done, f"the answer of {name}")
        return answer.result()

    def switch(self, *activate):
        return self.call(SwitchControllets, "switch_controllets", activate=list(activate))

    def hand(self, arm):
        at = self.states[arm].pose.position
        return at.x, at.y, at.z

    def owners(self):
        return [self.states[arm].owner for arm in ARMS]


def main():
    rclpy.init()
    node = TwoArms(sys.argv[1] if len(sys.argv) > 1 else "/multipanda")
    node.until(lambda: len(node.states) == 2, "robot_state of both arms; is the run started with --ros?")
    print(f"owners: {node.owners()}")

    # 1. One law takes both arms in the same cycle. An arm is never without an owner in between.
    result = node.switch("coupled")
    if not result.accepted:
        sys.exit(f"two_arms: refused: {result.reason}")
    print(
        f"{result.started} instead of {sorted(result.stopped)}; largest torque step {max(result.torque_step):.2f} N m"
    )
    node.until(lambda: node.owners() == ["coupled", "coupled"], "the new owner of both arms")

    # 2. The law moves a frame midway between the hands, and keeps the hands' places in it.
    goals = node.create_publisher(PoseStamped, f"{node.controller}/coupled/pose/goal", 1)
    node.until(lambda: goals.get_subscription_count() > 0, "the input's topic")
    apart = math.dist(node.hand("left"), node.hand("right"))
    middle = [(a + b) / 2 for a, b in zip(node.hand("left"), node.hand("right"))]
    goal = PoseStamped()  # no frame_id: the input's own, here the world; no rotation: the axes of the world
    goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = middle[0], middle[1], middle[2] + 0.1
    goals.publish(goal)
    node.until(lambda: all(node.hand(arm)[2] > middle[2] + 0.098 for arm in ARMS), "both hands to rise")
    changed = math.dist(node.hand("left"), node.hand("right")) - apart
    print(f"both hands rose by 10 cm; their distance changed by {1e3 * abs(changed):.1f} mm")

    # 3. A feature is added to the law while it runs.
    added = node.call(SetFeatures, "set_features", instance="coupled", features=["collision_avoidance"], on=[True])
    print(f"collision_avoidance: {added.verdict} in cycle {added.cycle}")

    # 4. Two laws for one arm: refused before anything changes.
    refused = node.switch("dual", "left_joint")
    print(f"refused: {refused.verdict}; owners are still {node.owners()}")

    # 5. Back to one law per arm.
    result = node.switch("left_cartesian", "right_cartesian")
    print(f"{sorted(result.started)} instead of {result.stopped}")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
