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

// Reads every state interface, as a user would see the hardware.
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

// A controller_manager whose loop the test runs: nothing moves between two calls of cycles(), and
// nothing sleeps. Requests that wait for the loop (switching) are sent from another thread while this
// one runs cycles.
class ManagedRobot {
 public:
  // `parameters`: text of a ROS parameter file, for the manager and all controllers.
  ManagedRobot(const std::string& urdf, const std::string& parameters);
  ~ManagedRobot();

  // For hardware with its own clock: every cycle reads until `fresh` returns true, which means that there is
  // new data. Gives up after 0.5 s, since arms may be silent.
  void pace(std::function<bool()> fresh) { fresh_ = std::move(fresh); }
  void cycles(int count);
  // Runs cycles until `done` returns true or the limit is reached; then returns false.
  bool cycles_until(const std::function<bool()>& done, int limit);

  bool load(const std::string& controller);  // and configures it
  // As load(), for a controller of the test itself.
  bool add(const std::shared_ptr<controller_interface::ControllerInterface>& controller,
           const std::string& name);
  // As the service with STRICT. Within one read-update-write of the loop.
  bool switch_to(const std::vector<std::string>& activate, const std::vector<std::string>& deactivate = {});
  bool unload(const std::string& controller);
  std::string state_of(const std::string& controller) const;  // "active", "inactive", ..., "" if not loaded
  std::string hardware_state(const std::string& component);   // by the manager's own service
  bool set_hardware_state(const std::string& component, const std::string& state);

  // Waits for a request from another thread (a service) while it runs cycles.
  template <class Future>
  auto finish(Future answer) {
    cycles_until([&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; },
                 kLimit);
    return answer.get();
  }

  Probe& probe() { return *probe_; }
  double value(const std::string& interface) const { return probe_->value(interface); }
  controller_manager::ControllerManager& manager() { return *manager_; }
  std::shared_ptr<rclcpp::Node> user() { return user_; }  // a user's node, spun in its own thread
  controller_interface::return_type last_update() const { return last_update_; }
  int failed_updates() const { return failed_updates_; }

 private:
  static constexpr int kLimit = 2'000'000;  // number of cycles; the answer takes a few

  void cycle();
  // Controllers get the elapsed time from the manager's clock, not from the caller of its update().
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
