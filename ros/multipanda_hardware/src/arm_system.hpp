#pragma once

#include <memory>
#include <string>
#include <vector>

#include "compat.hpp"
#include "ros/host/hardware_host.hpp"

namespace multipanda_hardware {

using CallbackReturn = hardware_interface::CallbackReturn;
using hardware_interface::return_type;

// Any number of arms as one ros2_control component. configure connects; activate lets controllers
// claim interfaces; deactivate makes every arm hold itself; cleanup disconnects. Each arm reports
// faults through its own interfaces. The component fails only if no arm is left. The work is done
// in ros/host/hardware_host.hpp.
class ArmSystem : public hardware_interface::SystemInterface {
 public:
  explicit ArmSystem(multipanda::ros::HardwareHost::Kind kind) : kind_(kind) {}
  ~ArmSystem() override { disconnect(); }  // a manager may skip the last steps of the life cycle when it ends

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
  void leave();  // the same, deferred to another thread

  multipanda::ros::HardwareHost::Kind kind_;
  rclcpp::Node::SharedPtr node_;  // for the arms' services, which the host owns; outlives it
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
