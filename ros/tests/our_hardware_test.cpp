// Our controller and others on our hardware: the same tests on MuJoCo and on virtual arms behind sockets.
#include <array>
#include <cmath>
#include <multipanda_msgs/srv/recover_from_error.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <multipanda_semantic_components/robot_model.hpp>
#include <multipanda_semantic_components/robot_state.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>
#include <std_srvs/srv/set_bool.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/host/arm_view.hpp"
#include "tested_robot.hpp"
#include "virtual_arms.hpp"

namespace multipanda::ros2_control_tests {
namespace {

using testing::HasSubstr;

constexpr double kUserStopped = 5, kMove = 2;  // <arm>/mode, as in multipanda_msgs/RobotState

struct Plant {
  const char* name;
  bool virtual_arms;
};
std::ostream& operator<<(std::ostream& out, const Plant& plant) { return out << plant.name; }

class OurHardware : public testing::TestWithParam<Plant> {
 protected:
  void SetUp() override {
    if (!GetParam().virtual_arms) return;
    if (program().empty()) GTEST_SKIP() << "no multipanda program: set MULTIPANDA_PROGRAM";
    arms_ = std::make_unique<VirtualArms>(kArms);
  }
  void begin(const std::string& text = parameters()) {
    robot_ = std::make_unique<Robot>(
        arms_ ? fci_component("arms", kArms, arms_->addresses()) : mujoco_component("arms", kArms), text);
    ASSERT_EQ(robot_->managed.hardware_state("arms"), "active");
    if (arms_) pace_by_packets();
    robot_->managed.probe().reset_worst();
  }
  // Arms behind sockets take a moment to start a motion, and controllets start after that.
  void wait_for_motion(const std::vector<std::string>& arms = kArms) {
    for (const auto& arm : arms) {
      EXPECT_TRUE(managed().cycles_until([&] { return managed().value(arm + "/mode") == kMove; }, 20'000))
          << arm;
    }
    managed().cycles(50);
  }
  // Runs one cycle per state of the arms, so that the arms' clock paces the test: a new sequence number means
  // a new state.
  void pace_by_packets() {
    for (const auto& arm : kArms) {
      views_.emplace_back(ros::ArmView::from_interface(robot_->managed.value(arm + "/multipanda_state")), 0);
      ASSERT_TRUE(static_cast<bool>(views_.back().first)) << arm;
    }
    robot_->managed.pace([this] {
      for (const auto& [arm, sequence] : views_) {
        if (arm.sequence() == sequence) return false;
      }
      for (auto& [arm, sequence] : views_) sequence = arm.sequence();
      return true;
    });
  }
  void TearDown() override {
    robot_.reset();
    arms_.reset();
  }
  ManagedRobot& managed() { return robot_->managed; }
  std::unique_ptr<VirtualArms> arms_;
  std::unique_ptr<Robot> robot_;
  std::vector<std::pair<ros::ArmView, std::uint64_t>> views_;
};

TEST_P(OurHardware, HoldsThroughLifeCyclesOfHardwareAndController) {
  begin();
  const auto left = robot_->where("left"), right = robot_->where("right");
  for (const int life : {1, 2}) {
    SCOPED_TRACE(life);
    ASSERT_TRUE(managed().load("multimode"));
    ASSERT_TRUE(managed().switch_to({"multimode"}));
    wait_for_motion();
    managed().cycles(300);
    EXPECT_EQ(managed().value("left/mode"), kMove);
    ASSERT_TRUE(managed().switch_to({}, {"multimode"}));
    managed().cycles(300);
    ASSERT_TRUE(managed().unload("multimode"));
  }
  EXPECT_LT(robot_->distance("left", left), 2e-3);
  EXPECT_LT(robot_->distance("right", right), 2e-3);
  EXPECT_LT(robot_->worst_speed("left"), 0.05);
  ASSERT_TRUE(managed().set_hardware_state("arms", "inactive"));
  ASSERT_TRUE(managed().set_hardware_state("arms", "unconfigured"));
  managed().cycles(10);
  EXPECT_EQ(managed().hardware_state("arms"), "unconfigured");
  ASSERT_TRUE(managed().set_hardware_state("arms", "active"));
  EXPECT_EQ(managed().hardware_state("arms"), "active");
  EXPECT_EQ(managed().failed_updates(), 0);
}

TEST_P(OurHardware, SwitchesByServiceWithABroadcaster) {
  begin();
  ASSERT_TRUE(managed().load("multimode"));
  ASSERT_TRUE(managed().load("joint_states"));
  ASSERT_TRUE(managed().switch_to({"multimode", "joint_states"}));
  wait_for_motion();
  managed().cycles(100);
  managed().probe().reset_worst();
  const auto start = robot_->where("left");
  multipanda_msgs::srv::SwitchControllets::Request request;
  request.activate = {"left_pose"};
  auto answer =
      robot_->call<multipanda_msgs::srv::SwitchControllets>("/multimode/switch_controllets", request);
  EXPECT_TRUE(answer->accepted) << answer->reason;
  EXPECT_THAT(answer->started, testing::ElementsAre("left_pose"));
  EXPECT_THAT(answer->stopped, testing::ElementsAre("left_joints"));
  EXPECT_THAT(answer->kept, testing::Contains("right_joints"));
  managed().cycles(500);
  EXPECT_LT(robot_->distance("left", start), 2e-3);
  EXPECT_LT(robot_->worst_speed("left"), 0.05);

  request.activate = {"nobody"};
  answer = robot_->call<multipanda_msgs::srv::SwitchControllets>("/multimode/switch_controllets", request);
  EXPECT_FALSE(answer->accepted);
  EXPECT_THAT(answer->reason, HasSubstr("nobody"));

  request.activate = {"both"};
  answer = robot_->call<multipanda_msgs::srv::SwitchControllets>("/multimode/switch_controllets", request);
  EXPECT_TRUE(answer->accepted) << answer->reason;
  managed().cycles(500);
  EXPECT_LT(robot_->distance("left", start), 2e-3);
}

TEST_P(OurHardware, ATargetIsReached) {
  begin();
  ASSERT_TRUE(managed().load("multimode"));
  ASSERT_TRUE(managed().switch_to({"multimode"}));
  wait_for_motion();
  const auto right = robot_->where("right");
  auto goal = robot_->where("left");
  goal[3] += 0.2;
  robot_->send_joints("/multimode/left_joints/joints/goal", "left", goal);
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->distance("left", goal) < 1e-3; }, 100'000))
      << robot_->distance("left", goal);
  EXPECT_LT(robot_->distance("right", right), 2e-3);
}

TEST_P(OurHardware, ForwardControllerDrivesTheOtherArm) {
  begin();
  ASSERT_TRUE(managed().load("multimode_left"));
  ASSERT_TRUE(managed().load("forward_right"));
  ASSERT_TRUE(managed().switch_to({"multimode_left", "forward_right"}));
  wait_for_motion({"left"});
  managed().cycles(100);
  const auto left = robot_->where("left");
  const double before = robot_->q("right", 7);
  std_msgs::msg::Float64MultiArray torques;
  torques.data = {0, 0, 0, 0, 0, 0, 0.1};
  const auto sender = robot_->send("/forward_right/commands", torques);
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->q("right", 7) > before + 0.01; }, 100'000));
  EXPECT_LT(robot_->distance("left", left), 2e-3);
  EXPECT_FALSE(
      managed().switch_to({"multimode"}));  // its arms are taken, or it is not loaded: nothing changes
  EXPECT_EQ(managed().state_of("multimode_left"), "active");
}

// Velocities of joints, then of the end effector, small enough to start with a step (5 rad/s^2, 1 m/s^2).
TEST_P(OurHardware, VelocitiesDriveAnArm) {
  begin();
  ASSERT_TRUE(managed().load("turn_right"));
  ASSERT_TRUE(managed().load("shift_right"));
  ASSERT_TRUE(managed().switch_to({"turn_right"}));
  wait_for_motion({"right"});
  managed().cycles(600);  // faded in
  std_msgs::msg::Float64MultiArray speeds;
  speeds.data = {0, 0, 0, 0, 0, 0, 0.005};
  const double joint7 = robot_->q("right", 7), joint1 = robot_->q("right", 1);
  const auto turning = robot_->send("/turn_right/commands", speeds);
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->q("right", 7) > joint7 + 0.002; }, 20'000));
  const double before = robot_->q("right", 7);
  managed().cycles(2000);
  EXPECT_NEAR(robot_->q("right", 7) - before, 2 * 0.005, 2e-4);
  EXPECT_NEAR(robot_->q("right", 1), joint1, 1e-3);

  // Only one kind of command drives an arm at a time.
  EXPECT_FALSE(managed().switch_to({"shift_right"}));
  ASSERT_TRUE(managed().switch_to({"shift_right"}, {"turn_right"}));
  wait_for_motion({"right"});
  managed().cycles(600);
  const std::string x = "right_ee_cartesian_position/12", y = "right_ee_cartesian_position/13";
  const double x_begin = managed().value(x), y_begin = managed().value(y);
  speeds.data = {0.001, 0, 0, 0, 0, 0};
  const auto shifting = robot_->send("/shift_right/commands", speeds);
  EXPECT_TRUE(managed().cycles_until([&] { return managed().value(x) > x_begin + 0.0005; }, 20'000));
  const double x_before = managed().value(x);
  managed().cycles(2000);
  EXPECT_NEAR(managed().value(x) - x_before, 2 * 0.001, 5e-5);
  EXPECT_NEAR(managed().value(y), y_begin, 2e-4);
  EXPECT_EQ(managed().failed_updates(), 0);
}

// A user's controller that reads an arm through the semantic components.
class Observer : public controller_interface::ControllerInterface {
 public:
  controller_interface::CallbackReturn on_init() override {
    return controller_interface::CallbackReturn::SUCCESS;
  }
  controller_interface::InterfaceConfiguration command_interface_configuration() const override {
    return {controller_interface::interface_configuration_type::NONE, {}};
  }
  controller_interface::InterfaceConfiguration state_interface_configuration() const override {
    auto names = state_.get_state_interface_names();
    for (const auto& name : model_.get_state_interface_names()) names.push_back(name);
    return {controller_interface::interface_configuration_type::INDIVIDUAL, names};
  }
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State&) override {
    const bool all = state_.assign_loaned_state_interfaces(state_interfaces_) &&
                     model_.assign_loaned_state_interfaces(state_interfaces_);
    return all ? controller_interface::CallbackReturn::SUCCESS
               : controller_interface::CallbackReturn::FAILURE;
  }
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) override {
    state_.release_interfaces();
    model_.release_interfaces();
    return controller_interface::CallbackReturn::SUCCESS;
  }
  controller_interface::return_type update(const rclcpp::Time&, const rclcpp::Duration&) override {
    valid = state_.get_values_as_message(state) && model_.get_values_as_message(model);
    if (const auto arm = model_.get()) arm.mass(mass);
    return controller_interface::return_type::OK;
  }
  bool valid = false;
  multipanda_msgs::msg::RobotState state;
  multipanda_msgs::msg::RobotModel model;
  std::array<double, 49> mass{};

 private:
  multipanda_semantic_components::RobotState state_{"right"};
  multipanda_semantic_components::RobotModel model_{"right"};
};

TEST_P(OurHardware, AControllerSeesAnArmThroughSemanticComponents) {
  begin();
  const auto observer = std::make_shared<Observer>();
  ASSERT_TRUE(managed().add(observer, "onlooker"));
  ASSERT_TRUE(managed().load("multimode"));
  ASSERT_TRUE(managed().switch_to({"multimode", "onlooker"}));
  wait_for_motion();
  managed().cycles(100);
  ASSERT_TRUE(observer->valid);
  EXPECT_EQ(observer->state.mode, multipanda_msgs::msg::RobotState::MODE_MOVE);
  for (int j = 1; j <= 7; ++j) {
    EXPECT_EQ(observer->state.q.at(static_cast<std::size_t>(j - 1)), robot_->q("right", j));
  }
  EXPECT_EQ(observer->model.jacobian.size(), 42u);
  EXPECT_GT(observer->mass[0], 0.01);
  EXPECT_DOUBLE_EQ(observer->mass[1], observer->mass[7]);

  // Without the hardware the view is empty and its memory is not accessed.
  ASSERT_TRUE(managed().switch_to({}, {"multimode", "onlooker"}));
  ASSERT_TRUE(managed().set_hardware_state("arms", "inactive"));
  ASSERT_TRUE(managed().set_hardware_state("arms", "unconfigured"));
  EXPECT_FALSE(managed().switch_to({"onlooker"}));
  managed().cycles(10);
}

// Arm A under the multimode controller and arm B under a trajectory controller; then swapped in one switch.
TEST_P(OurHardware, MultimodeAndTrajectoryControllersSwapTheirArms) {
  begin();
  for (const char* name : {"multimode_left", "multimode_right", "trajectory_left", "trajectory_right"}) {
    ASSERT_TRUE(managed().load(name)) << name;
  }
  ASSERT_TRUE(managed().switch_to({"multimode_left", "trajectory_right"}));
  wait_for_motion();
  managed().cycles(200);
  const auto left = robot_->where("left");
  auto goal = robot_->where("right");
  goal[0] += 0.15;
  robot_->send_trajectory("trajectory_right", "right", goal, 2);
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->distance("right", goal) < 2e-3; }, 20'000))
      << robot_->distance("right", goal);
  EXPECT_LT(robot_->distance("left", left), 2e-3);
  managed().cycles(1000);

  managed().probe().reset_worst();
  ASSERT_TRUE(
      managed().switch_to({"multimode_right", "trajectory_left"}, {"multimode_left", "trajectory_right"}));
  wait_for_motion();
  managed().cycles(500);
  EXPECT_LT(robot_->worst_speed("left"), 0.05);
  EXPECT_LT(robot_->worst_speed("right"), 0.05);
  EXPECT_LT(robot_->distance("right", goal), 4e-3);

  const auto right = robot_->where("right");
  goal = left;
  goal[0] -= 0.15;
  robot_->send_trajectory("trajectory_left", "left", goal, 2);
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->distance("left", goal) < 2e-3; }, 20'000))
      << robot_->distance("left", goal);
  EXPECT_LT(robot_->distance("right", right), 2e-3);
  EXPECT_EQ(managed().failed_updates(), 0);
}

// One arm's user stop: the other arm, the controller and the component continue; afterwards the arm can be
// used again.
TEST_P(OurHardware, OneArmsFaultDoesNotAffectTheOther) {
  begin();
  ASSERT_TRUE(managed().load("multimode"));
  ASSERT_TRUE(managed().switch_to({"multimode"}));
  wait_for_motion();
  managed().cycles(100);
  const auto right = robot_->where("right");
  const auto press = [&](bool pressed) {
    if (arms_)
      return arms_->control(pressed ? "user-stop left on" : "user-stop left off").find("ok") !=
             std::string::npos;
    std_srvs::srv::SetBool::Request request;
    request.data = pressed;
    return robot_->call<std_srvs::srv::SetBool>("/left/set_user_stop", request)->success;
  };
  ASSERT_TRUE(press(true));
  EXPECT_TRUE(managed().cycles_until([&] { return managed().value("left/mode") == kUserStopped; }, 100'000));
  managed().cycles(500);
  EXPECT_EQ(managed().hardware_state("arms"), "active");
  EXPECT_EQ(managed().state_of("multimode"), "active");
  EXPECT_EQ(managed().value("right/mode"), kMove);
  EXPECT_LT(robot_->distance("right", right), 2e-3);
  auto goal = right;
  goal[0] += 0.1;
  robot_->send_joints("/multimode/right_joints/joints/goal", "right", goal);
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->distance("right", goal) < 1e-3; }, 100'000));

  ASSERT_TRUE(press(false));
  managed().cycles(100);
  robot_->call<multipanda_msgs::srv::RecoverFromError>("/left/recover",
                                                       multipanda_msgs::srv::RecoverFromError::Request());
  EXPECT_TRUE(managed().cycles_until([&] { return managed().value("left/mode") == kMove; }, 100'000));
  const auto left = robot_->where("left");
  managed().cycles(300);
  EXPECT_LT(robot_->distance("left", left), 2e-3);
}

TEST_P(OurHardware, ItsNodeKeepsItsNameInAProcessThatRenamesNodes) {
  begin();
  EXPECT_STREQ(managed().user()->get_name(),
               "controller_manager");  // the rule is at work: this node was "user"
  EXPECT_THAT(managed().user()->get_node_names(), testing::Contains("/multipanda_arms").Times(1));
}

// All addresses stop answering: the component is in error and its controllers end. When they answer again, it
// is configured and activated again.
class VirtualHardware : public OurHardware {};

TEST_P(VirtualHardware, AComponentWithoutArmsIsInErrorAndRecovers) {
  begin();
  ASSERT_TRUE(managed().load("multimode"));
  ASSERT_TRUE(managed().switch_to({"multimode"}));
  wait_for_motion();
  managed().pace({});
  views_.clear();
  const auto addresses = arms_->addresses();
  arms_.reset();
  for (int i = 0; i < 200 && managed().hardware_state("arms") == "active"; ++i) managed().cycles(10);
  EXPECT_EQ(managed().hardware_state("arms"), "unconfigured");
  EXPECT_NE(managed().state_of("multimode"), "active");
  EXPECT_FALSE(managed().set_hardware_state("arms", "active"));  // no arm answers yet

  arms_ = std::make_unique<VirtualArms>(kArms, addresses);
  ASSERT_TRUE(managed().set_hardware_state("arms", "inactive"));
  ASSERT_TRUE(managed().set_hardware_state("arms", "active"));
  ASSERT_TRUE(managed().switch_to({"probe", "multimode"}));
  managed().cycles(5);
  pace_by_packets();
  wait_for_motion();
  const auto left = robot_->where("left");
  managed().cycles(300);
  EXPECT_LT(robot_->distance("left", left), 2e-3);
  EXPECT_EQ(managed().value("left/mode"), kMove);
}

INSTANTIATE_TEST_SUITE_P(Fci, VirtualHardware, testing::Values(Plant{"fci", true}));
INSTANTIATE_TEST_SUITE_P(All, OurHardware, testing::Values(Plant{"mujoco", false}, Plant{"fci", true}),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace multipanda::ros2_control_tests
