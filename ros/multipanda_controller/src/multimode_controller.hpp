#pragma once

#include <controller_interface/controller_interface.hpp>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "ros/host/controller_host.hpp"

namespace multipanda_controller {

using CallbackReturn = controller_interface::CallbackReturn;

// multipanda's control cycle as a ros2_control controller. Claims the efforts of its arms' joints; reads
// their position, velocity, effort and, if the hardware offers it, the arm's full state
// (<arm>/multipanda_state). Its node carries topics, services and actions (docs/ros_interfaces.md) and the
// parameters of docs/ros2_control.md. The work is done in ros/host/controller_host.hpp.
class MultimodeController : public controller_interface::ControllerInterface {
 public:
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) override;

  CallbackReturn on_init() override;
  CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_cleanup(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_error(const rclcpp_lifecycle::State& previous) override;
  CallbackReturn on_shutdown(const rclcpp_lifecycle::State& previous) override;

 private:
  multipanda::ros::FlatParameters scene_parameters();
  void declare_parameters();
  rcl_interfaces::msg::SetParametersResult set_parameters(const std::vector<rclcpp::Parameter>& parameters);
  bool take_states();
  void leave_commands();
  void release();

  std::unique_ptr<multipanda::ros::ControllerHost> host_;
  // never locked by the loop: users may set parameters while the host is destroyed
  std::mutex host_mutex_;
  std::vector<std::string> declared_;  // controllets' parameters on the node, until cleanup
  rclcpp_lifecycle::LifecycleNode::OnSetParametersCallbackHandle::SharedPtr on_set_;
  bool active_ = false;
};

}  // namespace multipanda_controller
