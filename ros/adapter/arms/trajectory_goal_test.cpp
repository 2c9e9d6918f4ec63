#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/gripper.hpp"
#include "ros/adapter/arms/motion_actions.hpp"

namespace multipanda::ros::trajectory_goal_test {
namespace {

using control_msgs::action::FollowJointTrajectory;
using control_msgs::action::GripperCommand;
using ::testing::HasSubstr;
using Result = FollowJointTrajectory::Result;

const auto kJoints = joint_names("left", 7);

FollowJointTrajectory::Goal two_points() {
  FollowJointTrajectory::Goal goal;
  goal.trajectory.joint_names = {"left_joint4", "left_joint2"};
  for (int i = 1; i <= 2; ++i) {
    auto& point = goal.trajectory.points.emplace_back();
    point.positions = {-2.0 - 0.1 * i, -0.5 + 0.2 * i};
    point.velocities = {i == 1 ? 0.3 : 0.0, i == 1 ? -0.2 : 0.0};
    point.time_from_start.sec = i;
    point.time_from_start.nanosec = 500'000'000;
  }
  return goal;
}

// Thresholds of a service may be lower than the scene's, and no number of them higher.
TEST(CollisionThresholds, AreNotRaisedAboveTheScenes) {
  SetCollisionThresholds scene;
  scene.nominal.torque_lower = scene.nominal.torque_upper = JointVector::LinSpaced(7, 10, 40);
  scene.nominal.wrench_lower = scene.nominal.wrench_upper = Vector6::LinSpaced(6, 30, 5);
  SetCollisionThresholds asked = scene;
  const auto refusal = [&]() -> std::string {
    try {
      refuse_looser(asked, scene);
      return "accepted";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  EXPECT_EQ(refusal(), "accepted");
  asked.nominal.torque_upper[2] = 21;
  EXPECT_THAT(refusal(), ::testing::AllOf(HasSubstr("upper_torque_thresholds_nominal of joint 3: 21"),
                                          HasSubstr("exceeds 20"), HasSubstr("'collision'")));
  asked.nominal.torque_upper[2] = 1;
  asked.nominal.torque_lower[2] = 500;  // only reports
  EXPECT_EQ(refusal(), "accepted");
  asked.nominal.wrench_upper[5] = 5.5;
  EXPECT_THAT(refusal(), HasSubstr("upper_force_thresholds_nominal of axis 6: 5.5"));
  asked = scene;
  asked.acceleration = scene.nominal;
  asked.acceleration->torque_upper[0] = 11;
  EXPECT_THAT(refusal(), HasSubstr("upper_torque_thresholds_acceleration of joint 1: 11"));
  scene.acceleration = asked.acceleration;
  EXPECT_EQ(refusal(), "accepted");
  // Without thresholds of their own, accelerating arms get the nominal ones.
  scene.acceleration->torque_upper[6] = 35;
  asked.acceleration.reset();
  EXPECT_THAT(refusal(), HasSubstr("upper_torque_thresholds_acceleration of joint 7: 40"));
}

TEST(CollisionThresholds, LowerOnesAreNotAboveUpperOnes) {
  SetCollisionThresholds asked;
  asked.nominal.torque_lower = asked.nominal.torque_upper = JointVector::LinSpaced(7, 10, 40);
  asked.nominal.wrench_lower = asked.nominal.wrench_upper = Vector6::LinSpaced(6, 30, 5);
  EXPECT_NO_THROW(refuse_unordered(asked));
  asked.acceleration = asked.nominal;
  asked.acceleration->wrench_lower[5] = 5.5;
  EXPECT_THROW(refuse_unordered(asked), std::invalid_argument);
  asked.acceleration.reset();
  asked.nominal.torque_lower[2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(refuse_unordered(asked), std::invalid_argument);
}

TEST(ArmRequests, GuidingAndVacuumAreRead) {
  multipanda_msgs::srv::SetGuidingMode::Request guiding;
  guiding.axes = {true, false, true, false, false, true};
  guiding.elbow = true;
  const auto mode = std::get<SetGuidingMode>(read_request(guiding, 7));
  EXPECT_THAT(mode.axes, ::testing::ElementsAre(true, false, true, false, false, true));
  EXPECT_TRUE(mode.elbow);
  multipanda_msgs::srv::VacuumOn::Request on;  // with the defaults of the definition
  const auto pump = std::get<VacuumOn>(read_request(on));
  EXPECT_EQ(pump.pressure_mbar, VacuumOn{}.pressure_mbar);
  EXPECT_EQ(pump.timeout_s, VacuumOn{}.timeout_s);
}

TEST(TrajectoryGoal, AcceptsSomeJointsInAnyOrder) {
  auto goal = two_points();
  auto& tolerance = goal.path_tolerance.emplace_back();
  tolerance.name = "left_joint2";
  tolerance.position = 0.05;
  tolerance.velocity = -1;
  goal.goal_time_tolerance.sec = 4;
  const TrajectoryGoal read = read_trajectory(goal, kJoints, 0);
  ASSERT_EQ(read.points.size(), 2U);
  EXPECT_DOUBLE_EQ(read.points[0].time_s, 1.5);
  EXPECT_DOUBLE_EQ(read.points[1].position[3], -2.2);
  EXPECT_DOUBLE_EQ(read.points[1].position[1], -0.1);
  for (const int j : {0, 2, 4, 5, 6}) {
    EXPECT_TRUE(std::isnan(read.points[0].position[j]));
    EXPECT_EQ(read.points[0].velocity[j], 0);
  }
  EXPECT_EQ(read.points[0].velocity[3], 0.3);
  EXPECT_EQ(read.points[0].acceleration.size(), 0);
  EXPECT_EQ(read.path_position[1], 0.05);
  EXPECT_EQ(read.path_position[3], 0);
  EXPECT_EQ(read.path_velocity[1], 0) << "-1 is no limit";
  EXPECT_EQ(read.goal_position.size(), 0);
  EXPECT_EQ(read.goal_time_s, 4);
  EXPECT_EQ(read.delay_s, 0);
}

TEST(TrajectoryGoal, FutureStampsDelayAndOldOnesAreRefused) {
  auto goal = two_points();
  goal.trajectory.header.stamp.sec = 100;
  EXPECT_DOUBLE_EQ(read_trajectory(goal, kJoints, 99'250'000'000).delay_s, 0.75);
  EXPECT_DOUBLE_EQ(read_trajectory(goal, kJoints, 100'500'000'000).delay_s, 0);
  try {
    read_trajectory(goal, kJoints, 102'000'000'000);
    FAIL();
  } catch (const TrajectoryRefused& refused) {
    EXPECT_EQ(refused.code, Result::OLD_HEADER_TIMESTAMP);
    EXPECT_THAT(refused.what(), HasSubstr("2 s ago"));
  }
}

struct Bad {
  const char* name;
  std::function<void(FollowJointTrajectory::Goal&)> spoil;
  int code;
  const char* words;
};

class Refusals : public testing::TestWithParam<Bad> {};

TEST_P(Refusals, StateWhatWasExpected) {
  auto goal = two_points();
  GetParam().spoil(goal);
  try {
    read_trajectory(goal, kJoints, 0);
    FAIL();
  } catch (const TrajectoryRefused& refused) {
    EXPECT_EQ(refused.code, GetParam().code);
    EXPECT_THAT(refused.what(), HasSubstr(GetParam().words));
  }
}

using Goal = FollowJointTrajectory::Goal;
INSTANTIATE_TEST_SUITE_P(
    TrajectoryGoal, Refusals,
    testing::Values(Bad{"name", [](Goal& g) { g.trajectory.joint_names[0] = "right_joint4"; },
                        Result::INVALID_JOINTS, "'right_joint4'; expected names of left_joint1, "},
                    Bad{"twice", [](Goal& g) { g.trajectory.joint_names[0] = "left_joint2"; },
                        Result::INVALID_JOINTS, "twice"},
                    Bad{"no_names", [](Goal& g) { g.trajectory.joint_names.clear(); }, Result::INVALID_JOINTS,
                        "no joint"},
                    Bad{"no_points", [](Goal& g) { g.trajectory.points.clear(); }, Result::INVALID_GOAL,
                        "no point"},
                    Bad{"size", [](Goal& g) { g.trajectory.points[1].positions.pop_back(); },
                        Result::INVALID_GOAL, "point 2 has 1 positions for 2"},
                    Bad{"nan", [](Goal& g) { g.trajectory.points[0].velocities[0] = std::nan(""); },
                        Result::INVALID_GOAL, "not finite"},
                    Bad{"times", [](Goal& g) { g.trajectory.points[1].time_from_start.sec = 1; },
                        Result::INVALID_GOAL, "must increase"},
                    Bad{"no_positions", [](Goal& g) { g.trajectory.points[0].positions.clear(); },
                        Result::INVALID_GOAL, "no positions"},
                    Bad{"moving_end", [](Goal& g) { g.trajectory.points[1].velocities[0] = 0.2; },
                        Result::INVALID_GOAL, "must be 0"},
                    Bad{"tolerance_name", [](Goal& g) { g.goal_tolerance.emplace_back().name = "elbow"; },
                        Result::INVALID_JOINTS, "'elbow'"},
                    Bad{"frames", [](Goal& g) { g.multi_dof_trajectory.points.emplace_back(); },
                        Result::INVALID_GOAL, "multi_dof"}),
    [](const auto& each) { return each.param.name; });

TEST(GripperCommands, MoveOrGraspByEffortAndDirection) {
  GripperCommand::Goal goal;
  goal.command.position = 0.02;
  const GripperRequest moves = read_gripper_command(goal, 0.08, 0.08);
  ASSERT_TRUE(std::holds_alternative<GripperMove>(moves));
  EXPECT_DOUBLE_EQ(std::get<GripperMove>(moves).width, 0.04);
  goal.command.max_effort = 30;
  const GripperRequest closes = read_gripper_command(goal, 0.08, 0.08);
  ASSERT_TRUE(std::holds_alternative<GripperGrasp>(closes));
  EXPECT_DOUBLE_EQ(std::get<GripperGrasp>(closes).width, 0.04);
  EXPECT_DOUBLE_EQ(std::get<GripperGrasp>(closes).force, 30);
  EXPECT_TRUE(std::holds_alternative<GripperMove>(read_gripper_command(goal, 0.01, 0.08))) << "opens";
  goal.command.position = 0.08;
  EXPECT_THROW(read_gripper_command(goal, 0.01, 0.08), std::invalid_argument);
  goal.command.position = -0.01;
  EXPECT_THROW(read_gripper_command(goal, 0.01, 0.08), std::invalid_argument);
  goal.command.position = std::nan("");
  EXPECT_THROW(read_gripper_command(goal, 0.01, 0.08), std::invalid_argument);
}

TEST(ArmRequests, ConvertMessagesAndRefuseInvalidOnes) {
  multipanda_msgs::srv::SetJointStiffness::Request joints;
  joints.joint_stiffness = {1, 2, 3, 4, 5, 6, 7};
  EXPECT_EQ(std::get<SetJointStiffness>(read_request(joints, 7)).stiffness[6], 7);
  EXPECT_THROW(read_request(joints, 6), std::invalid_argument);
  joints.joint_stiffness.assign(100, 1.0);  // more than any arm has
  EXPECT_THROW(read_request(joints, 7), std::invalid_argument);

  multipanda_msgs::srv::SetToolFrame::Request tool;
  tool.pose.position.z = 0.2;
  tool.pose.orientation.w = std::sqrt(0.5);
  tool.pose.orientation.x = std::sqrt(0.5);  // 90 degrees about x
  const auto frames = std::get<SetFrames>(read_request(tool, 7));
  ASSERT_TRUE(frames.X_FE && !frames.X_EK);
  EXPECT_NEAR((frames.X_FE->rotation * Vector3::UnitY() - Vector3::UnitZ()).norm(), 0, 1e-12);
  EXPECT_EQ(frames.X_FE->position.z(), 0.2);
  tool.pose.orientation.w = 0.2;
  EXPECT_THROW(read_request(tool, 7), std::invalid_argument);
  tool.pose.orientation.w = std::numeric_limits<double>::infinity();
  EXPECT_THROW(read_request(tool, 7), std::invalid_argument);

  multipanda_msgs::srv::SetLoad::Request load;
  load.mass = 1.5;
  load.center_of_mass = {0.1, 0.2, 0.3};
  load.load_inertia = {1, 4, 5, 4, 2, 6, 5, 6, 3};
  const Load read = std::get<SetLoad>(read_request(load, 7)).load;
  EXPECT_EQ(read.p_FC.y(), 0.2);
  EXPECT_EQ(read.inertia_C(1, 2), 6);
  EXPECT_EQ(read.inertia_C(2, 2), 3);

  multipanda_msgs::srv::SetCollisionBehavior::Request collision;
  collision.lower_torque_thresholds_nominal.assign(7, 10);
  collision.upper_torque_thresholds_nominal.assign(7, 20);
  collision.upper_force_thresholds_nominal = {1, 2, 3, 4, 5, 6};
  auto thresholds = std::get<SetCollisionThresholds>(read_request(collision, 7));
  EXPECT_FALSE(thresholds.acceleration);
  EXPECT_EQ(thresholds.nominal.torque_upper[3], 20);
  EXPECT_EQ(thresholds.nominal.wrench_upper[5], 6);
  collision.lower_torque_thresholds_acceleration.assign(7, 1);
  EXPECT_THROW(read_request(collision, 7), std::invalid_argument) << "the upper ones are missing";
  collision.upper_torque_thresholds_acceleration.assign(7, 2);
  EXPECT_TRUE(std::get<SetCollisionThresholds>(read_request(collision, 7)).acceleration);
}

}  // namespace
}  // namespace multipanda::ros::trajectory_goal_test
