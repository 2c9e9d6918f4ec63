// Goals of clients of multipanda_ros2: what moves an arm, and what does not.
#include <algorithm>
#include <compat_test_msgs/msg/cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/dual_cartesian_impedance_goal.hpp>
#include <compat_test_msgs/msg/joint_goal.hpp>
#include <compat_test_msgs/msg/velocity_goal.hpp>
#include <multipanda_msgs/action/joint_via_motion.hpp>
#include <sensor_msgs/msg/joint_state.hpp>

#include "ros/adapter/compat/testing/compat_fixture.hpp"

namespace multipanda::ros::compat_test {
namespace {

// The operator who asks for a controllet, or for one without goals, finds the arm standing still, although
// the client of another name goes on streaming to it. Both names are one controllet here.
TEST_F(Compat, AnArmStandsStillWhenAnotherNameIsAskedFor) {
  const auto velocities = sender<msg::VelocityGoal>("/right/panda_joint_velocity_controller/desired_pose");
  const auto positions = sender<msg::JointGoal>("/right/panda_joint_impedance_controller/desired_pose");
  msg::VelocityGoal turn;
  turn.qd = {0, 0, 0, 0, 0, 0, 0.1};
  for (const std::string asked :
       {"panda_joint_impedance_controller", "comless_panda_joint_impedance_controller"}) {
    set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_velocity_controller", "right"}});
    const double before = state(1).q[6];
    ASSERT_TRUE(stream(*velocities, turn, "panda_joint_velocity_controller", "right", "right_joint",
                       [&] { return std::abs(newest(1).q[6] - before) > 0.03; }));
    const std::jthread goes_on = keep_streaming(*velocities, turn);
    set({{asked, "right"}});
    const double q = state(1).q[6];
    EXPECT_EQ(owner(1), "right_joint");
    EXPECT_THAT(active(), testing::Contains(asked + " on right"));
    const std::uint64_t were = refused();
    double most = 0;
    EXPECT_TRUE(wait_for([&] {
      most = std::max(most, std::abs(newest(1).q[6] - q));
      return refused() >= were + 400;
    }));
    EXPECT_LT(most, 0.01) << "0.04 rad at the speed of the stream";
    EXPECT_EQ(owner(1), "right_joint");
    turn.qd[6] *= -1;
  }
  set({{"panda_joint_impedance_controller", "right"}});
  const std::uint64_t taken = accepted();
  msg::JointGoal here;
  here.q = state(1).q;
  EXPECT_TRUE(stream(*positions, here, "panda_joint_impedance_controller", "right", "right_joint",
                     [&] { return accepted() > taken; }));
}

// As theirs, a controllet that is asked for again starts again, where the arm is.
TEST_F(Compat, AskingAgainStartsAgain) {
  set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_impedance_controller", "right"}});
  Publisher<sensor_msgs::msg::JointState> goals(client->node, "/mc/left_joint/joints/goal", Qos::reliable(1),
                                                Doc{});
  ASSERT_TRUE(wait_for([&] { return goals.subscribers() > 0; }));
  const auto before = state(0).q;
  sensor_msgs::msg::JointState far;
  far.position.assign(before.begin(), before.end());
  far.position[6] += before[6] > 0.5 ? -1.0 : 1.0;
  goals.publish(far);
  ASSERT_TRUE(wait_for([&] { return std::abs(newest(0).q[6] - before[6]) > 0.1; }));
  set({{"panda_joint_impedance_controller", "left"}});
  const double q = state(0).q[6];
  ASSERT_GT(std::abs(q - far.position[6]), 0.2) << "the goal came too early to tell";
  double most = 0;
  for (int k = 0; k < 600; ++k) {
    std::this_thread::sleep_for(1ms);
    most = std::max(most, std::abs(newest(0).q[6] - q));
  }
  EXPECT_LT(most, 0.05) << "it would go on at up to 0.5 rad/s";
  EXPECT_EQ(owner(0), "left_joint");
}

// A trajectory of MoveIt, or any other motion, is over where its controllet starts again.
TEST_F(Compat, AMotionEndsWhenItsControlletStartsAgain) {
  using Motion = multipanda_msgs::action::JointViaMotion;
  ActionClient<Motion> action{client->executor, client->node, "/left/joint_via_motion"};
  ASSERT_TRUE(action.wait_until_ready(30));
  std::uint8_t number = 0;
  for (const std::string asked :
       {"comless_panda_joint_impedance_controller", "panda_joint_impedance_controller"}) {
    set({{"panda_joint_impedance_controller", "left"}});
    const auto before = state(0).q;
    Motion::Goal goal;
    goal.via_poses.emplace_back();
    goal.via_poses[0].positions.assign(before.begin(), before.end());
    goal.via_poses[0].positions[6] += before[6] > 0.7 ? -0.8 : 0.8;
    goal.velocity_scale = 0.2;
    const Uuid id{++number};
    ASSERT_TRUE(action.send(id, goal).get().accepted);
    auto result = action.result(id);
    const auto is_over = [&] { return result.wait_for(0s) == std::future_status::ready; };
    ASSERT_TRUE(wait_for([&] { return is_over() || std::abs(newest(0).q[6] - before[6]) > 0.05; }));
    ASSERT_FALSE(is_over()) << result.get().result.error;
    set({{asked, "left"}});
    const double q = state(0).q[6];
    ASSERT_EQ(result.wait_for(30s), std::future_status::ready);
    EXPECT_THAT(result.get().result.error, HasSubstr("started again"));
    double most = 0;
    for (int k = 0; k < 600; ++k) {
      std::this_thread::sleep_for(1ms);
      most = std::max(most, std::abs(newest(0).q[6] - q));
    }
    EXPECT_LT(most, 0.02);
    // A sample that was posted just then is a stream that falls silent.
    EXPECT_THAT(owner(0), testing::AnyOf("left_joint", "left_hold"));
  }
}

// Their guard against jumps, and against a stream that went on while its arm stood still.
TEST_F(Compat, FarGoalsMoveNothing) {
  const std::string name = "panda_cartesian_impedance_controller";
  set({{name, "left"}, {name, "right"}});
  const auto goals = sender<msg::CartesianImpedanceGoal>("/left/" + name + "/desired_pose");
  ASSERT_TRUE(wait_for([&] {
    const auto dq = state(0).dq;
    return std::all_of(dq.begin(), dq.end(), [](double v) { return std::abs(v) < 5e-3; });
  }));
  const auto before = state(0).o_t_ee;
  const auto moved = [&] {
    const auto now = state(0).o_t_ee;
    return std::hypot(now[12] - before[12], now[13] - before[13], now[14] - before[14]);
  };
  const auto far = [&](auto change) {
    msg::CartesianImpedanceGoal goal;
    goal.pose = pose_of(before);
    change(goal);
    return goal;
  };
  for (const auto& goal : {msg::CartesianImpedanceGoal(), far([](auto& g) { g.pose.position.z += 0.11; })}) {
    const std::uint64_t were = refused();
    const std::jthread goes_on = keep_streaming(*goals, goal);
    set({{name, "left"}});
    ASSERT_TRUE(wait_for([&] { return refused() >= were + 100; }));
    set({{name, "left"}});
    ASSERT_TRUE(wait_for([&] { return refused() >= were + 300; }));
    EXPECT_LT(moved(), 1e-3);
    EXPECT_EQ(owner(0), "left_hand");
  }
}

TEST_F(Compat, AStreamedPoseIsFollowedInTheBaseAndHeldAfterwards) {
  set({{"panda_cartesian_impedance_controller", "left"}, {"panda_cartesian_impedance_controller", "right"}});
  const auto goals =
      sender<msg::CartesianImpedanceGoal>("/left/panda_cartesian_impedance_controller/desired_pose");
  const auto before = state(0);
  msg::CartesianImpedanceGoal goal;
  goal.pose = pose_of(before.o_t_ee);
  goal.pose.position.x += 0.03;
  goal.pose.position.y -= 0.02;
  ASSERT_TRUE(stream(*goals, goal, "panda_cartesian_impedance_controller", "left", "left_hand", [&] {
    const auto now = newest(0).o_t_ee;
    return std::hypot(now[12] - goal.pose.position.x, now[13] - goal.pose.position.y) < 3e-3;
  }));
  ASSERT_TRUE(wait_for([] { return owner(0) == "left_hold"; })) << "when it is silent";
  EXPECT_EQ(owner(1), "right_hand");
  goal.pose.orientation.w = 5;
  ASSERT_TRUE(stream(*goals, goal, "panda_cartesian_impedance_controller", "left", "left_hand",
                     [] { return trouble("left_hand/pose").find("unit quaternion") != std::string::npos; }));
}

TEST_F(Compat, TwoPosesAreFollowedTogetherOrNotAtAll) {
  set({{"dual_cartesian_impedance_controller", "left&right"}});
  const auto goals = sender<msg::DualCartesianImpedanceGoal>(
      "/left_and_right/dual_cartesian_impedance_controller/desired_pose");
  msg::DualCartesianImpedanceGoal goal;
  goal.l_pose = pose_of(state(0).o_t_ee);
  goal.r_pose = pose_of(state(1).o_t_ee);
  goal.l_pose.position.z += 0.02;
  goal.r_pose.position.z += 0.03;
  goal.r_pose.position.y = NAN;
  const std::uint64_t taken = accepted(), were = refused();
  goals->publish(goal);
  ASSERT_TRUE(wait_for([&] { return refused() == were + 2; })) << "both arms' inputs refuse it";
  EXPECT_EQ(accepted(), taken);
  EXPECT_THAT(trouble("dual/first_pose"), HasSubstr("dual/second_pose: number 1 of 7 is not finite"));
  goal.r_pose.position.y = pose_of(state(1).o_t_ee).position.y;
  ASSERT_TRUE(stream(*goals, goal, "dual_cartesian_impedance_controller", "left&right", "dual", [&] {
    return std::abs(newest(0).o_t_ee[14] - goal.l_pose.position.z) < 3e-3 &&
           std::abs(newest(1).o_t_ee[14] - goal.r_pose.position.z) < 3e-3;
  }));
}

TEST_F(Compat, JointsFollowPositionsAndVelocities) {
  set({{"panda_joint_impedance_controller", "left"}, {"panda_joint_impedance_controller", "right"}});
  const auto positions = sender<msg::JointGoal>("/left/panda_joint_impedance_controller/desired_pose");
  msg::JointGoal goal;
  goal.q = state(0).q;
  goal.q[6] += 0.08;
  ASSERT_TRUE(stream(*positions, goal, "panda_joint_impedance_controller", "left", "left_joint",
                     [&] { return std::abs(newest(0).q[6] - goal.q[6]) < 0.01; }));
  const auto velocities = sender<msg::VelocityGoal>("/right/panda_joint_velocity_controller/desired_pose");
  set({{"panda_joint_velocity_controller", "right"}});
  const double q7 = state(1).q[6];
  msg::VelocityGoal turn;
  turn.qd = {0, 0, 0, 0, 0, 0, -0.2};
  ASSERT_TRUE(stream(*velocities, turn, "panda_joint_velocity_controller", "right", "right_joint",
                     [&] { return newest(1).q[6] < q7 - 0.05; }));
  ASSERT_TRUE(wait_for([] { return owner(1) == "right_hold"; })) << "when it is silent";
  EXPECT_GT(newest(1).q[6], q7 - 0.2) << "it does not run on";
  turn.qd[2] = 9;
  ASSERT_TRUE(stream(*velocities, turn, "panda_joint_velocity_controller", "right", "right_joint", [] {
    return trouble("right_joint/joints").find("joint 3: 9 rad/s") != std::string::npos;
  }));
}

}  // namespace
}  // namespace multipanda::ros::compat_test
