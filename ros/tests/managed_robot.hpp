#pragma once

#include <controller_interface/controller_interface.hpp>
#include <controller_manager/controller_manager.hpp>
#include <functional>
#include <future>
#include <hardware_interface/types/hardware_interface_return_values.hpp>
#include <map>
#include <memory>
#include <rclcpp/rclcpp.hpp>
#include <string>
#include <thread>
#include <vector>

namespace multipanda::ros2_control_tests {

// Reads every state interface there is; what a user would see of the hardware.
class Probe : public controller_interface::ControllerInterface {
 public:
  controller_interface::CallbackReturn on_init() override;
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) override;
  // By full name, "left_joint1/position". Throws std::out_of_range if there is none.
  double value(const std::string& name) const { return values_.at(name); }
  bool has(const std::string& name) const { return values_.count(name) > 0; }
  // Largest magnitude seen since reset_worst().
  double worst(const std::string& name) const { return worst_.at(name); }
  void reset_worst() { worst_.clear(); }

 private:
  std::map<std::string, double> values_, worst_;
};

// A controller_manager whose loop is the test: nothing moves between two calls of cycles(), and nothing
// sleeps. What waits for the loop (switching) is asked from another thread while this one goes through
// cycles.
class ManagedRobot {
 public:
  // `parameters`: text of a ROS parameter file, for the manager and all controllers.
  ManagedRobot(const std::string& urdf, const std::string& parameters);
  ~ManagedRobot();

  // For hardware with a clock of its own: every cycle reads until `fresh`, which says whether there is
  // something new. Gives up after 0.5 s, since arms may be silent.
  void pace(std::function<bool()> fresh) { fresh_ = std::move(fresh); }
  void cycles(int count);
  // Goes through cycles until `done` or the limit; false: the limit.
  bool cycles_until(const std::function<bool()>& done, int limit);

  bool load(const std::string& controller);  // and configure
  // The same for a controller of the test's own.
  bool add(const std::shared_ptr<controller_interface::ControllerInterface>& controller,
           const std::string& name);
  // As by the service with STRICT. In one read-update-write of the loop.
  bool switch_to(const std::vector<std::string>& activate, const std::vector<std::string>& deactivate = {});
  bool unload(const std::string& controller);
  std::string state_of(const std::string& controller) const;  // "active", "inactive", ..., "" if not loaded
  std::string hardware_state(const std::string& component);   // by the manager's own service
  bool set_hardware_state(const std::string& component, const std::string& state);

  // Waits for something asked from another thread (a service) by going through cycles.
  template <class Future>
  auto finish(Future answer) {
    cycles_until([&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; },
                 kPatience);
    return answer.get();
  }

  Probe& probe() { return *probe_; }
  double value(const std::string& interface) const { return probe_->value(interface); }
  controller_manager::ControllerManager& manager() { return *manager_; }
  std::shared_ptr<rclcpp::Node> user() { return user_; }  // a node of a user's, spun in a thread of its own
  controller_interface::return_type last_update() const { return last_update_; }
  int failed_updates() const { return failed_updates_; }

 private:
  static constexpr int kPatience = 2'000'000;  // cycles; whoever answers needs a few

  void cycle();
  // Controllers are told what time has passed by the manager's clock, not by whoever calls its update().
  void set_clock();

  std::string parameter_file_;
  std::function<bool()> fresh_;
  std::shared_ptr<rclcpp::executors::MultiThreadedExecutor> executor_;
  std::shared_ptr<controller_manager::ControllerManager> manager_;
  std::shared_ptr<Probe> probe_;
  std::shared_ptr<rclcpp::Node> user_;
  std::thread spinning_;
  rclcpp::Time time_;
  controller_interface::return_type last_update_ = controller_interface::return_type::OK;
  int failed_updates_ = 0;
};

}  // namespace multipanda::ros2_control_tests
