#include "multimode_controller.hpp"

#include <algorithm>
#include <limits>
#include <pluginlib/class_list_macros.hpp>

#include "compat.hpp"

namespace multipanda_controller {
namespace {

using multipanda::ros::ControllerHost;
using multipanda::ros::FlatParameters;

multipanda::ros::ParameterValue value_of(const rclcpp::ParameterValue& value) {
  switch (value.get_type()) {
    case rclcpp::ParameterType::PARAMETER_BOOL:
      return value.get<bool>();
    case rclcpp::ParameterType::PARAMETER_INTEGER:
      return value.get<std::int64_t>();
    case rclcpp::ParameterType::PARAMETER_DOUBLE:
      return value.get<double>();
    case rclcpp::ParameterType::PARAMETER_STRING:
      return value.get<std::string>();
    case rclcpp::ParameterType::PARAMETER_BOOL_ARRAY:
      return value.get<std::vector<bool>>();
    case rclcpp::ParameterType::PARAMETER_INTEGER_ARRAY:
      return value.get<std::vector<std::int64_t>>();
    case rclcpp::ParameterType::PARAMETER_DOUBLE_ARRAY:
      return value.get<std::vector<double>>();
    case rclcpp::ParameterType::PARAMETER_STRING_ARRAY:
      return value.get<std::vector<std::string>>();
    default:
      return std::string();
  }
}

}  // namespace

CallbackReturn MultimodeController::on_init() { return CallbackReturn::SUCCESS; }

// All parameters given to the node, declared or not.
FlatParameters MultimodeController::scene_parameters() {
  FlatParameters parameters;
  for (const auto& [name, value] : get_node()->get_node_parameters_interface()->get_parameter_overrides()) {
    if (value.get_type() != rclcpp::ParameterType::PARAMETER_NOT_SET)
      parameters.emplace_back(name, value_of(value));
  }
  return parameters;
}

CallbackReturn MultimodeController::on_configure(const rclcpp_lifecycle::State&) {
  release();
  try {
    if (compat::is_async(*this)) {
      throw std::invalid_argument(
          "is_async: not supported, since this controller shares memory with its hardware; set it to false");
    }
    multipanda::ros::ControllerHostOptions options;
    if (get_update_rate() > 0) options.period_s = 1.0 / get_update_rate();
    (void)get_node()->get_parameter("use_sim_time", options.simulated_time);
    options.robot_description = compat::robot_description(*this);
    const FlatParameters parameters = scene_parameters();
    if (options.robot_description.empty()) {
      for (const auto& [name, value] : parameters) {
        if (name == "robot_description" && std::holds_alternative<std::string>(value)) {
          options.robot_description = std::get<std::string>(value);
        }
      }
    }
    options.node = get_node()->get_node_base_interface()->get_rcl_node_handle();
    options.report = [logger = get_node()->get_logger()](const std::string& text) {
      RCLCPP_INFO(logger, "%s", text.c_str());
    };
    host_ = std::make_unique<ControllerHost>(parameters, options);
    declare_parameters();
  } catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    release();
    return CallbackReturn::FAILURE;
  }
  return CallbackReturn::SUCCESS;
}

// Dynamically typed, since only such parameters can be undeclared. The host checks types and bounds.
void MultimodeController::declare_parameters() {
  const auto& overrides = get_node()->get_node_parameters_interface()->get_parameter_overrides();
  for (auto& parameter : host_->parameters()) {
    const std::string& name = parameter.descriptor.name;
    parameter.descriptor.dynamic_typing = true;
    if (const auto it = overrides.find(name); it != overrides.end()) {
      rcl_interfaces::msg::Parameter requested;
      requested.name = name;
      requested.value = parameter.value = it->second.to_value_msg();
      if (const std::string why = host_->set_parameters({requested}); !why.empty())
        throw std::invalid_argument(why);
    }
    if (get_node()->has_parameter(name)) continue;  // older versions declare it automatically
    constexpr bool kIgnoreOverride = true;
    get_node()->declare_parameter(name, rclcpp::ParameterValue(parameter.value), parameter.descriptor,
                                  kIgnoreOverride);
    declared_.push_back(name);
  }
  on_set_ = get_node()->add_on_set_parameters_callback(
      [this](const std::vector<rclcpp::Parameter>& parameters) { return set_parameters(parameters); });
}

rcl_interfaces::msg::SetParametersResult MultimodeController::set_parameters(
    const std::vector<rclcpp::Parameter>& parameters) {
  rcl_interfaces::msg::SetParametersResult result;
  std::vector<rcl_interfaces::msg::Parameter> messages;
  for (const auto& parameter : parameters) messages.push_back(parameter.to_parameter_msg());
  const std::lock_guard lock(host_mutex_);
  if (host_ != nullptr) result.reason = host_->set_parameters(messages);
  result.successful = result.reason.empty();
  return result;
}

controller_interface::InterfaceConfiguration MultimodeController::command_interface_configuration() const {
  if (host_ == nullptr) return {controller_interface::interface_configuration_type::NONE, {}};
  return {controller_interface::interface_configuration_type::INDIVIDUAL, host_->command_names()};
}

controller_interface::InterfaceConfiguration MultimodeController::state_interface_configuration() const {
  if (host_ == nullptr) return {controller_interface::interface_configuration_type::NONE, {}};
  return {controller_interface::interface_configuration_type::INDIVIDUAL, host_->state_names()};
}

// Interfaces arrive in the requested order.
CallbackReturn MultimodeController::on_activate(const rclcpp_lifecycle::State&) {
  if (host_ == nullptr || state_interfaces_.size() != host_->states().size() ||
      command_interfaces_.size() != host_->commands().size()) {
    RCLCPP_ERROR(get_node()->get_logger(), "not all requested interfaces are available");
    return CallbackReturn::FAILURE;
  }
  std::fill(host_->states().begin(), host_->states().end(), std::numeric_limits<double>::quiet_NaN());
  (void)take_states();
  if (const std::string why = host_->activate(); !why.empty()) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", why.c_str());
    return CallbackReturn::FAILURE;
  }
  active_ = true;
  return CallbackReturn::SUCCESS;
}

controller_interface::return_type MultimodeController::update(const rclcpp::Time&,
                                                              const rclcpp::Duration& period) {
  (void)take_states();  // an interface held by another thread keeps its last value for this cycle
  const bool stands = host_->update(period.seconds());
  leave_commands();
  return stands ? controller_interface::return_type::OK : controller_interface::return_type::ERROR;
}

CallbackReturn MultimodeController::on_deactivate(const rclcpp_lifecycle::State&) {
  if (host_ != nullptr && active_) {
    (void)take_states();
    host_->deactivate();
    leave_commands();
  }
  active_ = false;
  return CallbackReturn::SUCCESS;
}

CallbackReturn MultimodeController::on_cleanup(const rclcpp_lifecycle::State&) {
  release();
  return CallbackReturn::SUCCESS;
}

CallbackReturn MultimodeController::on_error(const rclcpp_lifecycle::State& previous) {
  (void)on_deactivate(previous);
  release();
  return CallbackReturn::SUCCESS;
}

CallbackReturn MultimodeController::on_shutdown(const rclcpp_lifecycle::State& previous) {
  return on_error(previous);
}

void MultimodeController::release() {
  on_set_.reset();
  for (const auto& name : declared_) {
    if (get_node()->has_parameter(name)) get_node()->undeclare_parameter(name);
  }
  declared_.clear();
  active_ = false;
  const std::lock_guard lock(host_mutex_);
  host_.reset();
}

bool MultimodeController::take_states() {
  bool all = true;
  const auto states = host_->states();
  const std::size_t count = std::min(states.size(), state_interfaces_.size());
  for (std::size_t i = 0; i < count; ++i) all = compat::read(state_interfaces_[i], states[i]) && all;
  return all;
}

void MultimodeController::leave_commands() {
  const auto commands = host_->commands();
  const std::size_t count = std::min(commands.size(), command_interfaces_.size());
  for (std::size_t i = 0; i < count; ++i) (void)compat::write(command_interfaces_[i], commands[i]);
}

}  // namespace multipanda_controller

PLUGINLIB_EXPORT_CLASS(multipanda_controller::MultimodeController, controller_interface::ControllerInterface)
