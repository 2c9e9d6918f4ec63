// The calls of ros2_control plugins, without ros2_control: a controller and hardware in one process, on
// ROS nodes.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <fstream>
#include <iterator>
#include <map>
#include <multipanda_msgs/srv/recover_from_error.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/host/arm_view.hpp"
#include "ros/host/controller_host.hpp"
#include "ros/host/hardware_host.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros::host_test {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

void choose_domain() { ::setenv("ROS_DOMAIN_ID", std::to_string(1 + ::getpid() % 100).c_str(), 1); }

// A controller_manager's cycle.
class Loop {
 public:
  Loop(HardwareHost& hardware, ControllerHost& controller) : hardware_(hardware), controller_(controller) {
    std::map<std::string, double*> states, commands;
    for (const auto& n : hardware.states()) states[n.prefix + "/" + n.name] = n.value;
    for (const auto& n : hardware.commands()) commands[n.prefix + "/" + n.name] = n.value;
    for (const auto& name : controller.state_names()) states_.push_back(states.at(name));
    for (const auto& name : controller.command_names()) commands_.push_back(commands.at(name));
  }
  void take() {
    for (std::size_t i = 0; i < states_.size(); ++i) controller_.states()[i] = *states_[i];
  }
  bool step() {
    const bool alive = hardware_.read();
    take();
    const bool stands = controller_.update(0.001);
    for (std::size_t i = 0; i < commands_.size(); ++i) *commands_[i] = controller_.commands()[i];
    return hardware_.write(time_ns_ += 1'000'000) && alive && stands;
  }
  template <typename Condition>
  bool until(Condition condition) {
    for (int i = 0; i < 20000; ++i) {
      if (condition()) return true;
      step();
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    return condition();
  }

 private:
  HardwareHost& hardware_;
  std::int64_t time_ns_ = 0;
  ControllerHost& controller_;
  std::vector<double*> states_, commands_;
};

FlatParameters parameters() {
  return {{"arm_names", std::vector<std::string>{"left"}},
          {"controllets.pose.type", std::string("cartesian_impedance")},
          {"controllets.pose.arms", std::string("left")},
          {"controllets.joints.type", std::string("joint_impedance")},
          {"controllets.joints.arms", std::string("left")},
          {"active", std::string("joints")},
          {"update_rate", std::int64_t{1000}}};
}

TEST(Hosts, ControllerAndHardwareExchangeNumbersOnly) {
  HardwareHost hardware(HardwareHost::Kind::mujoco, {{"arm_names", "left"}}, {});
  ControllerHost controller(parameters(), {});
  EXPECT_EQ(controller.state_names().size(), 22u);
  EXPECT_EQ(controller.command_names().front(), "left_joint1/effort");
  Loop loop(hardware, controller);
  EXPECT_THAT(controller.activate(), HasSubstr("gravity_compensation"));  // the hardware has not reported yet
  hardware.connect();
  std::string why;
  ASSERT_TRUE(hardware.prepare_switch(controller.command_names(), {}, why)) << why;
  hardware.perform_switch(controller.command_names(), {});
  loop.take();
  ASSERT_EQ(controller.activate(), "");
  ASSERT_TRUE(loop.until([&] { return !controller.active().empty(); }));
  EXPECT_THAT(controller.active(), ElementsAre("joints"));

  // Parameters of controllets are listed with bounds, and set together or not at all.
  rcl_interfaces::msg::Parameter stiffness;
  for (const auto& parameter : controller.parameters()) {
    if (parameter.descriptor.name.starts_with("joints.stiffness")) {
      stiffness.name = parameter.descriptor.name;
      stiffness.value = parameter.value;
    }
  }
  ASSERT_FALSE(stiffness.name.empty());
  EXPECT_TRUE(controller.has_parameter(stiffness.name));
  std::string answer = "none yet";
  std::atomic<bool> answered{false};
  auto set = [&](double value) {
    answered = false;
    stiffness.value.double_array_value.assign(7, value);
    std::thread user([&] {
      answer = controller.set_parameters({stiffness});
      answered = true;
    });
    EXPECT_TRUE(loop.until([&] { return answered.load(); }));
    user.join();
    return answer;
  };
  EXPECT_EQ(set(100), "");
  EXPECT_THAT(set(-1), HasSubstr(stiffness.name));

  // Other controllers can read the hardware's data.
  for (const auto& n : hardware.states()) {
    if (n.name != "multipanda_state") continue;
    const ArmView arm = ArmView::from_interface(*n.value);
    ASSERT_TRUE(static_cast<bool>(arm));
    std::array<double, 49> M{};
    arm.mass(M);
    EXPECT_GT(M[0], 0.01);
    EXPECT_DOUBLE_EQ(M[1], M[7]);
    multipanda_msgs::msg::RobotState state;
    arm.state(state);
    EXPECT_EQ(state.mode, multipanda_msgs::msg::RobotState::MODE_MOVE);
    EXPECT_TRUE(std::equal(state.q.begin(), state.q.end(), arm.q().begin()));
    multipanda_msgs::msg::RobotModel model;
    arm.model(model);
    EXPECT_EQ(model.jacobian.size(), 42u);
    EXPECT_FALSE(static_cast<bool>(ArmView::from_interface(1.0)));
  }

  // Without the hardware there is no torque and no access to its memory.
  hardware.deactivate();
  hardware.disconnect();
  loop.take();
  EXPECT_FALSE(controller.update(0.001));
  EXPECT_THAT(controller.commands(), testing::Each(0.0));
  controller.deactivate();
}

// Torques that hold a still arm against gravity without the hardware's help.
std::vector<double> holding_torques(const FlatParameters& arm, const ControllerHostOptions& options) {
  FlatParameters given = parameters();
  given.emplace_back("arms.left.gravity_compensation", std::string("controller"));
  given.emplace_back("arms.left.state_interfaces", std::vector<std::string>{"position", "velocity"});
  given.insert(given.end(), arm.begin(), arm.end());
  ControllerHost controller(given, options);
  const double q[] = {0.1, -0.7, 0.2, -2.3, -0.3, 1.5, 0.8};
  for (std::size_t j = 0; j < 7; ++j) controller.states()[2 * j] = q[j];
  EXPECT_EQ(controller.activate(), "");
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(controller.update(0.001));
  EXPECT_THAT(controller.active(), ElementsAre("joints"));
  const auto commands = controller.commands();
  return {commands.begin(), commands.end()};
}

TEST(Hosts, ARobotDescriptionIsAModel) {
  std::ifstream file(MULTIPANDA_SOURCE_DIR "/models/generated/fer.urdf");
  ControllerHostOptions options;
  options.robot_description.assign(std::istreambuf_iterator<char>(file), {});
  const FlatParameters described = {{"arms.left.model", std::string("robot_description")},
                                    {"arms.left.base_link", std::string("link0")},
                                    {"arms.left.tip_link", std::string("flange")}};
  const auto torques = holding_torques(described, options);
  // The expected torque is the slope of the potential energy of the description's links, by finite
  // differences of sum(m g z), computed independently.
  EXPECT_THAT(torques,
              testing::Pointwise(testing::DoubleNear(1e-3),
                                 std::vector<double>{0, -3.6711, -3.4030, 18.5099, 0.3055, 1.4610, 0.0345}));
  EXPECT_THAT(torques, testing::Pointwise(testing::DoubleNear(1e-6),
                                          holding_torques({{"arms.left.hand", false}}, {})));

  FlatParameters all = parameters();
  all.insert(all.end(), described.begin(), described.end());
  EXPECT_EQ(ControllerHost(all, options).command_names().front(),
            "joint1/effort");                                    // as the description names it
  EXPECT_THROW(ControllerHost(all, {}), std::invalid_argument);  // there is none
  // The interfaces may have other names, but not those of the description in another order.
  std::vector<std::string> joints{"j1", "j2", "j3", "j4", "j5", "j6", "j7"};
  all.emplace_back("arms.left.joints", joints);
  EXPECT_EQ(ControllerHost(all, options).command_names().front(), "j1/effort");
  for (std::size_t i = 0; i < 7; ++i) joints[i] = "joint" + std::to_string(7 - i);
  all.back().second = joints;
  const auto refusal = [&] {
    try {
      ControllerHost(all, options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(refusal(), testing::HasSubstr("expected the order of the robot description, joint1, joint2"));
  all.back().second =
      std::vector<std::string>{"joint2", "joint3", "joint4", "joint5", "joint6", "joint7", "last"};
  EXPECT_THAT(refusal(), testing::HasSubstr("expected the order")) << "each one would reach its neighbor";
}

TEST(Hosts, ControlletsOfAnotherLibraryRunInTheController) {
  const FlatParameters given = {
      {"arm_names", std::vector<std::string>{"left"}},        {"plugins", std::vector<std::string>{PLUGIN}},
      {"controllets.wall.type", std::string("virtual_wall")}, {"controllets.wall.arms", std::string("left")},
      {"controllets.wall.parameters.height_m", -1.0},         {"active", std::string("wall")}};
  HardwareHost hardware(HardwareHost::Kind::mujoco, {{"arm_names", "left"}}, {});
  ControllerHost controller(given, {});
  hardware.connect();
  Loop loop(hardware, controller);
  hardware.perform_switch(controller.command_names(), {});
  loop.take();
  ASSERT_EQ(controller.activate(), "");
  EXPECT_TRUE(loop.until([&] { return !controller.active().empty(); }));
  EXPECT_THAT(controller.active(), ElementsAre("wall"));
  controller.deactivate();
  hardware.disconnect();
}

// What ArmSystem::on_error and on_cleanup do: once for an error in motion, and again for the cleanup that a
// manager may call after it. The node outlives the services on it, and the component connects again.
TEST(Hosts, AComponentInErrorIsLeftAtOnceAndConnectsAgain) {
  choose_domain();
  HardwareHost hardware(HardwareHost::Kind::mujoco, {{"arm_names", "left"}}, {});
  std::map<std::string, double*> numbers;
  for (const auto& n : hardware.states()) numbers["state " + n.prefix + "/" + n.name] = n.value;
  for (const auto& n : hardware.commands()) numbers["command " + n.prefix + "/" + n.name] = n.value;
  const double& position = *numbers.at("state left_joint1/position");
  std::vector<std::string> efforts;
  for (int j = 1; j <= 7; ++j) efforts.push_back("left_joint" + std::to_string(j) + "/effort");
  std::int64_t time_ns = 0;
  // Whether a torque of less than a step of 1 ms moves the arm. A component that was left may be called.
  const auto moves = [&](int cycles) {
    const double before = position;
    for (const auto& effort : efforts) *numbers.at("command " + effort) = effort == efforts[0] ? 0.9 : 0;
    for (int i = 0; i < cycles && std::abs(position - before) < 1e-4; ++i) {
      EXPECT_TRUE(hardware.read());
      EXPECT_TRUE(hardware.write(time_ns += 1'000'000));
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    return std::abs(position - before) >= 1e-4;
  };
  for (int k = 0; k < 2; ++k) {
    hardware.connect();
    EXPECT_TRUE(hardware.read());
    hardware.perform_switch(efforts, {});
    EXPECT_TRUE(moves(20000));
    struct Ros {
      Context context;
      Node node{context, "left_hardware"};
    };
    auto ros = std::make_shared<Ros>();
    hardware.serve(ros->node.handle());
    const std::weak_ptr<Ros> watched = ros;
    hardware.disconnect_later(std::move(ros));
    hardware.disconnect_later(nullptr);  // waits for the first
    EXPECT_TRUE(watched.expired());
    EXPECT_FALSE(moves(300));
  }
  hardware.connect();
  EXPECT_TRUE(hardware.read());
  hardware.disconnect();
}

TEST(Hosts, RefusalsNameTheParameter) {
  FlatParameters wrong = parameters();
  wrong.emplace_back("controllets.pose.parameters.stifness", 3.0);
  try {
    ControllerHost controller(wrong, {});
    FAIL() << "not refused";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("pose"));
  }
  EXPECT_THROW(HardwareHost(HardwareHost::Kind::fci, {{"arm_names", "left"}}, {}), std::invalid_argument);
  EXPECT_THROW(HardwareHost(HardwareHost::Kind::mujoco, {{"arm_names", "left"}, {"services", "maybe"}}, {}),
               std::invalid_argument);
}

TEST(Hosts, ServicesOfControllerAndHardwareAnswerOnTheirNodes) {
  choose_domain();
  Context context;
  Node node(context, "multimode"), hardware_node(context, "multipanda_arms"), user(context, "user");
  Executor executor;
  HardwareHost hardware(HardwareHost::Kind::mujoco, {{"arm_names", "left"}}, {});
  ControllerHostOptions options;
  options.node = node.handle();
  ControllerHost controller(parameters(), options);
  hardware.connect();
  hardware.serve(hardware_node.handle());
  Loop loop(hardware, controller);
  hardware.perform_switch(controller.command_names(), {});
  loop.take();
  ASSERT_EQ(controller.activate(), "");
  ASSERT_TRUE(loop.until([&] { return !controller.active().empty(); }));
  Client<multipanda_msgs::srv::SwitchControllets> switching(executor, user, "/multimode/switch_controllets");
  Client<multipanda_msgs::srv::RecoverFromError> recovering(executor, user, "/left/recover");
  executor.start();
  ASSERT_TRUE(loop.until([&] { return switching.ready() && recovering.ready(); }));
  multipanda_msgs::srv::SwitchControllets::Request request;
  request.activate = {"pose"};
  auto answer = switching.call(request);
  ASSERT_TRUE(
      loop.until([&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
  const auto response = answer.get();
  EXPECT_TRUE(response.accepted) << response.reason;
  EXPECT_THAT(controller.active(), Contains("pose"));
  auto recovered = recovering.call(multipanda_msgs::srv::RecoverFromError::Request());
  ASSERT_TRUE(
      loop.until([&] { return recovered.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
  EXPECT_FALSE(recovered.get().success);  // nothing to recover from
  executor.stop();
  controller.deactivate();
  hardware.stop_serving();
  hardware.disconnect();
}

}  // namespace
}  // namespace multipanda::ros::host_test
