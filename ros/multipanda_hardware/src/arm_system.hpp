#pragma once

#include <memory>
#include <string>
#include <vector>

#include "compat.hpp"
#include "ros/host/hardware_host.hpp"

namespace multipanda_hardware {

using CallbackReturn = hardware_interface::CallbackReturn;
using hardware_interface::return_type;

// Any number of arms as one component of ros2_control. All it does is in ros/host/hardware_host.hpp; here are
// only the calls. configure connects, activate lets controllers claim, deactivate leaves every arm to hold
// itself, cleanup disconnects. One arm's fault is told by its own interfaces; only if none is left the
// component is in error.
class ArmSystem : public hardware_interface::SystemInterface {
 public:
  explicit ArmSystem(multipanda::ros::HardwareHost::Kind kind) : kind_(kind) {}
  ~ArmSystem() override { disconnect(); }  // a manager that ends may leave out the life cycle's last steps

  CallbackReturn on_init(const compat::InitArgument& argument) override;
  CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_cleanup(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_error(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_shutdown(const rclcpp_lifecycle::State& previous) override;

  MULTIPANDA_HARDWARE_BEGIN_DEPRECATED
  std::vector<hardware_interface::StateInterface> export_state_interfaces() override;
  std::vector<hardware_interface::CommandInterface> export_command_interfaces() override;
  MULTIPANDA_HARDWARE_END_DEPRECATED

  return_type prepare_command_mode_switch(const std::vector<std::string>& start,
                                          const std::vector<std::string>& stop) override;
  return_type perform_command_mode_switch(const std::vector<std::string>& start,
                                          const std::vector<std::string>& stop) override;
  return_type read(const rclcpp::Time& time, const rclcpp::Duration& period) override;
  return_type write(const rclcpp::Time& time, const rclcpp::Duration& period) override;

 private:
  rclcpp::Logger logger() const { return rclcpp::get_logger("multipanda_hardware." + info_.name); }
  CallbackReturn fail(const std::string& text) const;
  void disconnect();

  multipanda::ros::HardwareHost::Kind kind_;
  rclcpp::Node::SharedPtr node_;  // of the arms' services, which the host has: outlives it
  std::unique_ptr<multipanda::ros::HardwareHost> host_;
};

class MujocoSystem : public ArmSystem {
 public:
  MujocoSystem() : ArmSystem(multipanda::ros::HardwareHost::Kind::mujoco) {}
};

class FciSystem : public ArmSystem {
 public:
  FciSystem() : ArmSystem(multipanda::ros::HardwareHost::Kind::fci) {}
};

}  // namespace multipanda_hardware
