// The controller on ros2_control's own mock hardware: joints that stay where they are and report the
// commanded effort.
#include <cmath>
#include <sensor_msgs/msg/joint_state.hpp>

#include <gtest/gtest.h>

#include "tested_robot.hpp"

namespace multipanda::ros2_control_tests {
namespace {

TEST(MockHardware, ControllerGoesThroughItsLifeCycle) {
  Robot robot(mock_component("mock", kArms), parameters(kForeign));
  ManagedRobot& managed = robot.managed;
  for (const int life : {1, 2}) {
    SCOPED_TRACE(life);
    ASSERT_TRUE(managed.load("multimode"));
    EXPECT_EQ(managed.state_of("multimode"), "inactive");
    ASSERT_TRUE(managed.switch_to({"multimode"}));
    EXPECT_EQ(managed.state_of("multimode"), "active");
    managed.cycles(100);
    for (const auto& arm : kArms) {
      for (int j = 1; j <= 7; ++j) EXPECT_NEAR(robot.effort(arm, j), 0, 1e-9) << arm << j;
    }
    ASSERT_TRUE(managed.switch_to({}, {"multimode"}));
    EXPECT_EQ(managed.state_of("multimode"), "inactive");
    ASSERT_TRUE(managed.unload("multimode"));
    EXPECT_EQ(managed.state_of("multimode"), "");
  }
  EXPECT_EQ(managed.failed_updates(), 0);
}

// The joints do not move, so the torque at rest is stiffness times distance: 600 N m/rad * 0.1 rad.
TEST(MockHardware, ControllerPullsAtItsStiffnessWithABroadcaster) {
  Robot robot(mock_component("mock", kArms), parameters(kForeign));
  ManagedRobot& managed = robot.managed;
  ASSERT_TRUE(managed.load("multimode"));
  ASSERT_TRUE(managed.load("joint_states"));
  ASSERT_TRUE(managed.switch_to({"multimode", "joint_states"}));
  int messages = 0;
  const auto listener = managed.user()->create_subscription<sensor_msgs::msg::JointState>(
      "/joint_states", rclcpp::SensorDataQoS(),
      [&](const sensor_msgs::msg::JointState& m) { messages += m.name.size() >= 14; });
  robot.send_joints("/multimode/left_joints/joints/goal", "left", home_with(1, 0.1));
  EXPECT_TRUE(
      managed.cycles_until([&] { return robot.effort("left", 1) > 59.999 && messages > 0; }, 300'000));
  managed.cycles(3000);  // at rest
  EXPECT_NEAR(robot.effort("left", 1), 60, 1e-6);
  for (int j = 2; j <= 7; ++j) EXPECT_NEAR(robot.effort("left", j), 0, 1e-6);
  for (int j = 1; j <= 7; ++j) EXPECT_NEAR(robot.effort("right", j), 0, 1e-9);
  EXPECT_EQ(managed.failed_updates(), 0);
}

// One arm uses the project's model, the other the robot description. Both hold themselves against gravity.
TEST(MockHardware, TheRobotDescriptionIsAModel) {
  std::string text = parameters(
      "gravity_compensation: controller, state_interfaces: [position, velocity, effort], hand: false");
  const std::string right = ", right: {";
  text.insert(text.find(right) + right.size(),
              "model: robot_description, base_link: right_link0, tip_link: right_flange, ");
  Robot robot(modeled_robot(mock_component("mock", kArms)), text);
  ManagedRobot& managed = robot.managed;
  ASSERT_TRUE(managed.load("multimode"));
  ASSERT_TRUE(managed.switch_to({"multimode"}));
  managed.cycles(100);
  EXPECT_GT(std::abs(robot.effort("left", 4)), 5);
  for (int j = 1; j <= 7; ++j) EXPECT_NEAR(robot.effort("left", j), robot.effort("right", j), 1e-6) << j;
  EXPECT_EQ(managed.failed_updates(), 0);
}

TEST(MockHardware, InvalidParametersAreRefusedAndTheManagerContinues) {
  std::string text = parameters(kForeign);
  text.replace(text.find("joint_impedance"), 15, "joint_impedence");
  Robot robot(mock_component("mock", kArms), text);
  EXPECT_FALSE(robot.managed.load("multimode"));
  ASSERT_TRUE(robot.managed.load("joint_states"));
  EXPECT_TRUE(robot.managed.switch_to({"joint_states"}));
}

}  // namespace
}  // namespace multipanda::ros2_control_tests
