// The controller and the hardware in a real controller_manager, whose loop is this test (managed_robot.hpp).
#include <array>
#include <cmath>
#include <controller_manager_msgs/srv/list_controllers.hpp>
#include <controller_manager_msgs/srv/switch_controller.hpp>
#include <cstdlib>
#include <multipanda_msgs/srv/recover_from_error.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <multipanda_semantic_components/robot_model.hpp>
#include <multipanda_semantic_components/robot_state.hpp>
#include <rcutils/logging.h>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>
#include <std_srvs/srv/set_bool.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "descriptions.hpp"
#include "managed_robot.hpp"
#include "ros/host/arm_view.hpp"
#include "virtual_arms.hpp"

namespace multipanda::ros2_control_tests {
namespace {

using testing::HasSubstr;

constexpr double kUserStopped = 5, kMove = 2;  // <arm>/mode, as in multipanda_msgs/RobotState

// Two arms, each owned by one of its own multimode controller, by one for both, or by somebody else.
const char* const kParameters = R"(
controller_manager:
  ros__parameters:
    update_rate: 1000
    multimode: {type: multipanda_controller/MultimodeController}
    multimode_left: {type: multipanda_controller/MultimodeController}
    multimode_right: {type: multipanda_controller/MultimodeController}
    joint_states: {type: joint_state_broadcaster/JointStateBroadcaster}
    forward_right: {type: forward_command_controller/ForwardCommandController}
    trajectory_left: {type: joint_trajectory_controller/JointTrajectoryController}
    trajectory_right: {type: joint_trajectory_controller/JointTrajectoryController}
multimode:
  ros__parameters:
    arm_names: [left, right]
    arms: ARMS
    controllets:
      left_joints: {type: joint_impedance, arms: left}
      right_joints: {type: joint_impedance, arms: right}
      left_pose: {type: cartesian_impedance, arms: left}
      both: {type: dual_cartesian_impedance, arms: [left, right]}
    active: [left_joints, right_joints]
multimode_left:
  ros__parameters:
    arm_names: [left]
    controllets: {left_joints: {type: joint_impedance, arms: left}}
    active: [left_joints]
multimode_right:
  ros__parameters:
    arm_names: [right]
    arms: {right: {base: {position_m: [0.0, 0.6, 0.0]}}}
    controllets: {right_joints: {type: joint_impedance, arms: right}}
    active: [right_joints]
forward_right:
  ros__parameters:
    joints: [right_joint1, right_joint2, right_joint3, right_joint4, right_joint5, right_joint6, right_joint7]
    interface_name: effort
trajectory_left:
  ros__parameters:
    joints: [left_joint1, left_joint2, left_joint3, left_joint4, left_joint5, left_joint6, left_joint7]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
trajectory_right:
  ros__parameters:
    joints: [right_joint1, right_joint2, right_joint3, right_joint4, right_joint5, right_joint6, right_joint7]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
)";

// `more`: of every arm.
std::string parameters(const std::string& more = "") {
  std::string text = kParameters;
  text.replace(text.find("ARMS"), 4,
               "{left: {" + more + "}, right: {" + more + (more.empty() ? "" : ", ") +
                   "base: {position_m: [0.0, 0.6, 0.0]}}}");
  if (more.empty()) text.replace(text.find("left: {}, "), 10, "");
  return text;
}

// Hardware that is not ours has no robot_state: what it does about gravity must be said.
const char* const kForeign = "gravity_compensation: robot, state_interfaces: [position, velocity, effort]";

const std::vector<std::string> kArms = {"left", "right"};

class Robot {
 public:
  Robot(const Component& component, const std::string& text) : Robot(robot({component}), text) {}
  Robot(const std::string& description, const std::string& text) : managed(description, text) {}

  double q(const std::string& arm, int joint) { return managed.value(joint_name(arm, joint) + "/position"); }
  double effort(const std::string& arm, int joint) {
    return managed.value(joint_name(arm, joint) + "/effort");
  }
  double worst_speed(const std::string& arm) {
    double worst = 0;
    for (int j = 1; j <= 7; ++j)
      worst = std::max(worst, managed.probe().worst(joint_name(arm, j) + "/velocity"));
    return worst;
  }
  double distance(const std::string& arm, const std::vector<double>& goal) {
    double worst = 0;
    for (int j = 1; j <= 7; ++j)
      worst = std::max(worst, std::abs(q(arm, j) - goal[static_cast<std::size_t>(j - 1)]));
    return worst;
  }
  std::vector<double> where(const std::string& arm) {
    std::vector<double> positions;
    for (int j = 1; j <= 7; ++j) positions.push_back(q(arm, j));
    return positions;
  }

  template <class Service>
  auto call(const std::string& name, typename Service::Request request) {
    const auto client = managed.user()->create_client<Service>(name);
    if (!managed.cycles_until([&] { return client->service_is_ready(); }, 300'000)) {
      throw std::runtime_error("no service " + name);
    }
    return managed.finish(
        client->async_send_request(std::make_shared<typename Service::Request>(std::move(request))).share());
  }

  // Sends until somebody listens, then `message` once.
  template <class Message>
  typename rclcpp::Publisher<Message>::SharedPtr send(const std::string& topic, const Message& message) {
    auto publisher = managed.user()->create_publisher<Message>(topic, rclcpp::QoS(10));
    EXPECT_TRUE(managed.cycles_until([&] { return publisher->get_subscription_count() > 0; }, 300'000))
        << topic;
    publisher->publish(message);
    return publisher;
  }

  // A joint target of our controller, streamed.
  void send_joints(const std::string& topic, const std::string& arm, const std::vector<double>& q_d) {
    sensor_msgs::msg::JointState message;
    for (int j = 1; j <= 7; ++j) message.name.push_back(joint_name(arm, j));
    message.position = q_d;
    senders_.push_back(send(topic, message));
  }

  void send_trajectory(const std::string& controller, const std::string& arm, const std::vector<double>& q_d,
                       int seconds) {
    trajectory_msgs::msg::JointTrajectory message;
    for (int j = 1; j <= 7; ++j) message.joint_names.push_back(joint_name(arm, j));
    message.points.resize(1);
    message.points[0].positions = q_d;
    // To rest: a quintic. Positions alone are a straight line, whose jump in velocity stops an arm.
    message.points[0].velocities.assign(7, 0.0);
    message.points[0].accelerations.assign(7, 0.0);
    message.points[0].time_from_start.sec = seconds;
    senders_.push_back(send("/" + controller + "/joint_trajectory", message));
  }

  ManagedRobot managed;

 private:
  std::vector<std::shared_ptr<rclcpp::PublisherBase>> senders_;
};

std::vector<double> home_with(int joint, double change) {
  std::vector<double> q = home();
  q[static_cast<std::size_t>(joint - 1)] += change;
  return q;
}

// --- Mock hardware: joints that stay where they are, and show the effort that they are commanded ---

TEST(MockHardware, ControllerGoesThroughItsLife) {
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

// The joints do not move, so that the torque at rest is stiffness times distance: 600 N m/rad * 0.1 rad.
TEST(MockHardware, ControllerPullsAtItsStiffnessBesideABroadcaster) {
  Robot robot(mock_component("mock", kArms), parameters(kForeign));
  ManagedRobot& managed = robot.managed;
  ASSERT_TRUE(managed.load("multimode"));
  ASSERT_TRUE(managed.load("joint_states"));
  ASSERT_TRUE(managed.switch_to({"multimode", "joint_states"}));
  int heard = 0;
  const auto listener = managed.user()->create_subscription<sensor_msgs::msg::JointState>(
      "/joint_states", rclcpp::SensorDataQoS(),
      [&](const sensor_msgs::msg::JointState& m) { heard += m.name.size() >= 14; });
  robot.send_joints("/multimode/left_joints/joints/goal", "left", home_with(1, 0.1));
  EXPECT_TRUE(managed.cycles_until([&] { return robot.effort("left", 1) > 59.999 && heard > 0; }, 300'000));
  managed.cycles(3000);  // at rest
  EXPECT_NEAR(robot.effort("left", 1), 60, 1e-6);
  for (int j = 2; j <= 7; ++j) EXPECT_NEAR(robot.effort("left", j), 0, 1e-6);
  for (int j = 1; j <= 7; ++j) EXPECT_NEAR(robot.effort("right", j), 0, 1e-9);
  EXPECT_EQ(managed.failed_updates(), 0);
}

// One arm's model is the project's, the other one's the robot description; both hold themselves against
// gravity.
TEST(MockHardware, TheRobotDescriptionIsAModel) {
  std::string text = parameters(
      "gravity_compensation: controller, state_interfaces: [position, velocity, effort], hand: false");
  const std::string right = ", right: {";
  text.insert(text.find(right) + right.size(),
              "model: robot_description, base_link: right_link0, tip_link: right_flange, ");
  Robot robot(modelled_robot(mock_component("mock", kArms)), text);
  ManagedRobot& managed = robot.managed;
  ASSERT_TRUE(managed.load("multimode"));
  ASSERT_TRUE(managed.switch_to({"multimode"}));
  managed.cycles(100);
  EXPECT_GT(std::abs(robot.effort("left", 2)), 5);
  for (int j = 1; j <= 7; ++j) EXPECT_NEAR(robot.effort("left", j), robot.effort("right", j), 1e-6) << j;
  EXPECT_EQ(managed.failed_updates(), 0);
}

TEST(MockHardware, WhatIsWrongIsRefusedAndTheManagerGoesOn) {
  std::string text = parameters(kForeign);
  text.replace(text.find("joint_impedance"), 15, "joint_impedence");
  Robot robot(mock_component("mock", kArms), text);
  EXPECT_FALSE(robot.managed.load("multimode"));
  ASSERT_TRUE(robot.managed.load("joint_states"));
  EXPECT_TRUE(robot.managed.switch_to({"joint_states"}));
}

// --- Our hardware: the same tests on MuJoCo, and on virtual arms behind sockets ---

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
  // Arms behind sockets take a moment to begin a motion; controllets start then.
  void wait_for_motion(const std::vector<std::string>& arms = kArms) {
    for (const auto& arm : arms) {
      EXPECT_TRUE(managed().cycles_until([&] { return managed().value(arm + "/mode") == kMove; }, 20'000))
          << arm;
    }
    managed().cycles(50);
  }
  // One cycle per state of the arms, so that time is theirs: their sequence numbers say when there is a new
  // one.
  void pace_by_packets() {
    for (const auto& arm : kArms) {
      seen_.emplace_back(ros::ArmView::behind(robot_->managed.value(arm + "/robot_state")), 0);
      ASSERT_TRUE(static_cast<bool>(seen_.back().first)) << arm;
    }
    robot_->managed.pace([this] {
      for (const auto& [arm, sequence] : seen_) {
        if (arm.sequence() == sequence) return false;
      }
      for (auto& [arm, sequence] : seen_) sequence = arm.sequence();
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
  std::vector<std::pair<ros::ArmView, std::uint64_t>> seen_;
};

TEST_P(OurHardware, HoldsThroughItsOwnAndTheControllersLife) {
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

TEST_P(OurHardware, SwitchesByServiceBesideABroadcaster) {
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

// A controller of a user's own, which sees an arm through the semantic components.
class Onlooker : public controller_interface::ControllerInterface {
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
    seen = state_.get_values_as_message(state) && model_.get_values_as_message(model);
    if (const auto arm = model_.get()) arm.mass(mass);
    return controller_interface::return_type::OK;
  }
  bool seen = false;
  multipanda_msgs::msg::RobotState state;
  multipanda_msgs::msg::RobotModel model;
  std::array<double, 49> mass{};

 private:
  multipanda_semantic_components::RobotState state_{"right"};
  multipanda_semantic_components::RobotModel model_{"right"};
};

TEST_P(OurHardware, AControllerSeesAnArmThroughSemanticComponents) {
  begin();
  const auto onlooker = std::make_shared<Onlooker>();
  ASSERT_TRUE(managed().add(onlooker, "onlooker"));
  ASSERT_TRUE(managed().load("multimode"));
  ASSERT_TRUE(managed().switch_to({"multimode", "onlooker"}));
  wait_for_motion();
  managed().cycles(100);
  ASSERT_TRUE(onlooker->seen);
  EXPECT_EQ(onlooker->state.mode, multipanda_msgs::msg::RobotState::MODE_MOVE);
  for (int j = 1; j <= 7; ++j) {
    EXPECT_EQ(onlooker->state.q.at(static_cast<std::size_t>(j - 1)), robot_->q("right", j));
  }
  EXPECT_EQ(onlooker->model.jacobian.size(), 42u);
  EXPECT_GT(onlooker->mass[0], 0.01);
  EXPECT_DOUBLE_EQ(onlooker->mass[1], onlooker->mass[7]);

  // The hardware goes: nothing to see, and no look into its memory.
  ASSERT_TRUE(managed().switch_to({}, {"multimode", "onlooker"}));
  ASSERT_TRUE(managed().set_hardware_state("arms", "inactive"));
  ASSERT_TRUE(managed().set_hardware_state("arms", "unconfigured"));
  EXPECT_FALSE(managed().switch_to({"onlooker"}));
  managed().cycles(10);
}

// Arm A under the multimode controller, arm B under a trajectory controller; then the other way round, in one
// switch.
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
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->distance("right", goal) < 2e-3; }, 100'000))
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
  EXPECT_TRUE(managed().cycles_until([&] { return robot_->distance("left", goal) < 2e-3; }, 100'000))
      << robot_->distance("left", goal);
  EXPECT_LT(robot_->distance("right", right), 2e-3);
  EXPECT_EQ(managed().failed_updates(), 0);
}

// One arm's stop button: the other arm, the controller and the component go on; afterwards it serves again.
TEST_P(OurHardware, OneArmsFaultIsItsOwn) {
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

INSTANTIATE_TEST_SUITE_P(All, OurHardware, testing::Values(Plant{"mujoco", false}, Plant{"fci", true}),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace multipanda::ros2_control_tests

int main(int argc, char** argv) {
  // Nothing leaves this computer, and no other test hears it, however it was started.
  setenv("ROS_DOMAIN_ID", std::to_string(101 + getpid() % 100).c_str(), 1);
  setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 0);
  setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 0);
  testing::InitGoogleMock(&argc, argv);
  rclcpp::init(argc, argv);
  (void)rcutils_logging_set_default_logger_level(RCUTILS_LOG_SEVERITY_WARN);
  const int result = RUN_ALL_TESTS();
  rclcpp::shutdown();
  return result;
}
