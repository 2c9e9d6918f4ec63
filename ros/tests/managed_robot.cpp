#include "managed_robot.hpp"

#include <cmath>
#include <controller_manager_msgs/srv/list_hardware_components.hpp>
#include <controller_manager_msgs/srv/set_hardware_component_state.hpp>
#include <controller_manager_msgs/srv/switch_controller.hpp>
#include <filesystem>
#include <fstream>
#include <lifecycle_msgs/msg/state.hpp>
#include <limits>
#include <mutex>
#include <rcl/time.h>
#include <stdexcept>
#include <unistd.h>

namespace multipanda::ros2_control_tests {
namespace {

// Newer versions return an optional, older ones the number.
template <class Interface>
double number(const Interface& interface) {
  if constexpr (requires { interface.get_optional(); }) {
    return interface.get_optional().value_or(std::numeric_limits<double>::quiet_NaN());
  } else {
    return interface.get_value();
  }
}

template <class Interface>
bool is_number(const Interface& interface) {
  if constexpr (requires { interface.get_data_type().to_string(); }) {
    return interface.get_data_type().to_string() == "double";
  } else {
    return true;
  }
}

// The clock of the manager's loop; newer versions have a separate one.
template <class Manager>
rclcpp::Clock::SharedPtr loop_clock(Manager& manager) {
  if constexpr (requires { manager.get_trigger_clock(); }) {
    return manager.get_trigger_clock();
  } else {
    return manager.get_clock();
  }
}

}  // namespace

controller_interface::CallbackReturn Probe::on_init() {
  return controller_interface::CallbackReturn::SUCCESS;
}

controller_interface::InterfaceConfiguration Probe::command_interface_configuration() const {
  return {controller_interface::interface_configuration_type::NONE, {}};
}

controller_interface::InterfaceConfiguration Probe::state_interface_configuration() const {
  return {controller_interface::interface_configuration_type::ALL, {}};
}

controller_interface::return_type Probe::update(const rclcpp::Time&, const rclcpp::Duration&) {
  for (const auto& interface : state_interfaces_) {
    if (!is_number(interface)) continue;
    const double value = number(interface);
    values_[interface.get_name()] = value;
    double& worst = worst_[interface.get_name()];
    if (std::abs(value) > worst) worst = std::abs(value);
  }
  return controller_interface::return_type::OK;
}

ManagedRobot::ManagedRobot(const std::string& urdf, const std::string& parameters) {
  std::string pattern = (std::filesystem::temp_directory_path() / "managed_robot_XXXXXX").string();
  const int file = mkstemp(pattern.data());
  if (file < 0) throw std::runtime_error("cannot make a temporary file in " + pattern);
  close(file);
  parameter_file_ = pattern;
  std::ofstream(parameter_file_) << parameters;

  executor_ = std::make_shared<rclcpp::executors::MultiThreadedExecutor>();
  rclcpp::NodeOptions options = controller_manager::get_cm_node_options();
  options.arguments({"--ros-args", "--params-file", parameter_file_});
  options.append_parameter_override("use_sim_time", true);  // which set_clock() sets
  manager_ = std::make_shared<controller_manager::ControllerManager>(executor_, urdf, true,
                                                                     "controller_manager", "", options);
  user_ = std::make_shared<rclcpp::Node>("user");
  executor_->add_node(manager_);
  executor_->add_node(user_);
  time_ = rclcpp::Time(std::int64_t{1'000'000'000}, loop_clock(*manager_)->get_clock_type());
  set_clock();
  probe_ = std::make_shared<Probe>();
  manager_->add_controller(probe_, "probe", "probe");
  manager_->configure_controller("probe");
  spinning_ = std::thread([executor = executor_] { executor->spin(); });
  if (!switch_to({"probe"})) {
    executor_->cancel();
    spinning_.join();
    throw std::runtime_error("the manager does not activate the probe");
  }
  cycles(2);
}

ManagedRobot::~ManagedRobot() {
  try {
    manager_->shutdown_controllers();  // returns their nodes to an executor that still runs
  } catch (const std::exception& error) {
    RCLCPP_WARN(manager_->get_logger(), "%s", error.what());
  }
  executor_->cancel();
  spinning_.join();
  probe_.reset();
  manager_.reset();
  user_.reset();
  std::filesystem::remove(parameter_file_);
}

void ManagedRobot::set_clock() {
  const auto clock = loop_clock(*manager_);
  const std::lock_guard lock(clock->get_clock_mutex());
  if (rcl_set_ros_time_override(clock->get_clock_handle(), time_.nanoseconds()) != RCL_RET_OK)
    throw std::runtime_error("the manager's clock cannot be set");
}

void ManagedRobot::cycle() {
  const auto period = rclcpp::Duration::from_nanoseconds(1'000'000);
  time_ = time_ + period;
  set_clock();
  manager_->read(time_, period);
  if (fresh_) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(500);
    while (!fresh_() && std::chrono::steady_clock::now() < deadline) {
      std::this_thread::yield();
      manager_->read(time_, period);
    }
  }
  last_update_ = manager_->update(time_, period);
  if (last_update_ != controller_interface::return_type::OK) ++failed_updates_;
  manager_->write(time_, period);
}

void ManagedRobot::cycles(int count) {
  for (int i = 0; i < count; ++i) cycle();
}

bool ManagedRobot::cycles_until(const std::function<bool()>& done, int limit) {
  for (int i = 0; i < limit; ++i) {
    if (done()) return true;
    cycle();
  }
  return done();
}

bool ManagedRobot::load(const std::string& controller) {
  // Both wait for the loop to take over the new list of controllers.
  return finish(std::async(std::launch::async, [this, controller] {
    return manager_->load_controller(controller) != nullptr &&
           manager_->configure_controller(controller) == controller_interface::return_type::OK;
  }));
}

bool ManagedRobot::add(const std::shared_ptr<controller_interface::ControllerInterface>& controller,
                       const std::string& name) {
  return finish(std::async(std::launch::async, [=, this] {
    return manager_->add_controller(controller, name, name) != nullptr &&
           manager_->configure_controller(name) == controller_interface::return_type::OK;
  }));
}

bool ManagedRobot::switch_to(const std::vector<std::string>& activate,
                             const std::vector<std::string>& deactivate) {
  return finish(std::async(std::launch::async, [=, this] {
           return manager_->switch_controller(activate, deactivate,
                                              controller_manager_msgs::srv::SwitchController::Request::STRICT,
                                              true, rclcpp::Duration::from_seconds(10));
         })) == controller_interface::return_type::OK;
}

bool ManagedRobot::unload(const std::string& controller) {
  return finish(std::async(std::launch::async, [=, this] {
           return manager_->unload_controller(controller);
         })) == controller_interface::return_type::OK;
}

std::string ManagedRobot::state_of(const std::string& controller) const {
  for (const auto& spec : manager_->get_loaded_controllers()) {
    if (spec.info.name == controller) return spec.c->get_lifecycle_state().label();
  }
  return "";
}

std::string ManagedRobot::hardware_state(const std::string& component) {
  using List = controller_manager_msgs::srv::ListHardwareComponents;
  const auto client = user_->create_client<List>("/controller_manager/list_hardware_components");
  if (!client->wait_for_service(std::chrono::seconds(10))) return "no service";
  auto answer = finish(client->async_send_request(std::make_shared<List::Request>()).share());
  for (const auto& found : answer->component) {
    if (found.name == component) return found.state.label;
  }
  return "";
}

bool ManagedRobot::set_hardware_state(const std::string& component, const std::string& state) {
  using Set = controller_manager_msgs::srv::SetHardwareComponentState;
  using lifecycle_msgs::msg::State;
  const std::map<std::string, std::uint8_t> ids = {{"unconfigured", State::PRIMARY_STATE_UNCONFIGURED},
                                                   {"inactive", State::PRIMARY_STATE_INACTIVE},
                                                   {"active", State::PRIMARY_STATE_ACTIVE},
                                                   {"finalized", State::PRIMARY_STATE_FINALIZED}};
  const auto client = user_->create_client<Set>("/controller_manager/set_hardware_component_state");
  if (!client->wait_for_service(std::chrono::seconds(10))) return false;
  auto request = std::make_shared<Set::Request>();
  request->name = component;
  request->target_state.id = ids.at(state);
  request->target_state.label = state;
  return finish(client->async_send_request(request).share())->ok;
}

}  // namespace multipanda::ros2_control_tests
