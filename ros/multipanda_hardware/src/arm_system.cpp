#include "arm_system.hpp"

#include <map>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

namespace multipanda_hardware {

using multipanda::ros::HardwareHost;

CallbackReturn ArmSystem::fail(const std::string& text) const {
  RCLCPP_ERROR(logger(), "%s", text.c_str());
  return CallbackReturn::ERROR;
}

CallbackReturn ArmSystem::on_init(const compat::InitArgument& argument) {
  if (hardware_interface::SystemInterface::on_init(argument) != CallbackReturn::SUCCESS)
    return CallbackReturn::ERROR;
  try {
    const std::map<std::string, std::string> parameters(info_.hardware_parameters.begin(),
                                                        info_.hardware_parameters.end());
    host_ = std::make_unique<HardwareHost>(kind_, parameters, [logger = logger()](const std::string& text) {
      RCLCPP_WARN(logger, "%s", text.c_str());
    });
  } catch (const std::exception& error) {
    return fail(error.what());
  }
  return CallbackReturn::SUCCESS;
}

CallbackReturn ArmSystem::on_configure(const rclcpp_lifecycle::State&) {
  try {
    host_->connect();
    if (host_->extras().services && rclcpp::ok()) {
      // A separate remap, because those of the process (`-r __node:=controller_manager`) would also rename
      // this node.
      const std::string name = "multipanda_" + info_.name;
      rclcpp::NodeOptions options;
      options.arguments({"--ros-args", "-r", "__node:=" + name});
      node_ = std::make_shared<rclcpp::Node>(name, options);
      host_->serve(node_->get_node_base_interface()->get_rcl_node_handle());
    }
  } catch (const std::exception& error) {
    disconnect();
    return fail(error.what());
  }
  return CallbackReturn::SUCCESS;
}

CallbackReturn ArmSystem::on_activate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }

CallbackReturn ArmSystem::on_deactivate(const rclcpp_lifecycle::State&) {
  if (host_) host_->deactivate();
  return CallbackReturn::SUCCESS;
}

CallbackReturn ArmSystem::on_cleanup(const rclcpp_lifecycle::State&) {
  leave();
  return CallbackReturn::SUCCESS;
}

// Leaves the arms safe without waiting: the manager calls this in its loop, and other components must not
// lose a period. The component can be configured again.
CallbackReturn ArmSystem::on_error(const rclcpp_lifecycle::State&) {
  leave();
  return CallbackReturn::SUCCESS;
}

void ArmSystem::leave() {
  if (host_) host_->disconnect_later(std::exchange(node_, nullptr));
}

CallbackReturn ArmSystem::on_shutdown(const rclcpp_lifecycle::State&) {
  disconnect();
  return CallbackReturn::SUCCESS;
}

void ArmSystem::disconnect() {
  if (!host_) return;
  host_->stop_serving();
  node_.reset();
  try {
    host_->disconnect();
  } catch (const std::exception& error) {
    RCLCPP_WARN(logger(), "%s", error.what());
  }
}

MULTIPANDA_HARDWARE_BEGIN_DEPRECATED
std::vector<hardware_interface::StateInterface> ArmSystem::export_state_interfaces() {
  std::vector<hardware_interface::StateInterface> interfaces;
  for (const auto& number : host_->states())
    interfaces.emplace_back(number.prefix, number.name, number.value);
  return interfaces;
}

std::vector<hardware_interface::CommandInterface> ArmSystem::export_command_interfaces() {
  std::vector<hardware_interface::CommandInterface> interfaces;
  for (const auto& number : host_->commands())
    interfaces.emplace_back(number.prefix, number.name, number.value);
  return interfaces;
}
MULTIPANDA_HARDWARE_END_DEPRECATED

return_type ArmSystem::prepare_command_mode_switch(const std::vector<std::string>& start,
                                                   const std::vector<std::string>& stop) {
  std::string why;
  if (host_->prepare_switch(start, stop, why)) return return_type::OK;
  RCLCPP_ERROR(logger(), "%s", why.c_str());
  return return_type::ERROR;
}

return_type ArmSystem::perform_command_mode_switch(const std::vector<std::string>& start,
                                                   const std::vector<std::string>& stop) {
  host_->perform_switch(start, stop);
  return return_type::OK;
}

return_type ArmSystem::read(const rclcpp::Time&, const rclcpp::Duration&) {
  return host_->read() ? return_type::OK : return_type::ERROR;
}

return_type ArmSystem::write(const rclcpp::Time& time, const rclcpp::Duration&) {
  return host_->write(time.nanoseconds()) ? return_type::OK : return_type::ERROR;
}

}  // namespace multipanda_hardware

PLUGINLIB_EXPORT_CLASS(multipanda_hardware::MujocoSystem, hardware_interface::SystemInterface)
PLUGINLIB_EXPORT_CLASS(multipanda_hardware::FciSystem, hardware_interface::SystemInterface)
