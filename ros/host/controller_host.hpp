#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <rcl/node.h>
#include <rcl_interfaces/msg/parameter.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

// The same type as in scene/from_parameters.hpp, which would include headers of the core.
namespace multipanda::ros {

using ParameterValue = std::variant<bool, std::int64_t, double, std::string, std::vector<bool>,
                                    std::vector<std::int64_t>, std::vector<double>, std::vector<std::string>>;
using FlatParameters = std::vector<std::pair<std::string, ParameterValue>>;

struct ControllerHostOptions {
  double period_s = 0.001;        // of the host's loop
  bool simulated_time = false;    // a simulation may pause that loop; otherwise a pause stops the arms
  std::string robot_description;  // URDF text, for arms with `model: robot_description`; may be empty
  // The controller's node, which gets the adapter's interfaces and must outlive the host. nullptr:
  // no interfaces.
  rcl_node_t* node = nullptr;
  // Receives messages for the user about the performance trace, possibly from another thread. May be empty.
  std::function<void(const std::string&)> report;
};

// The multimode controller for ros2_control. The interface uses only numbers and strings, so that packages
// that host it need no headers of the core.
class __attribute__((visibility("default"))) ControllerHost {
 public:
  // Builds everything. Throws std::invalid_argument or std::runtime_error with the cause and the remedy.
  ControllerHost(const FlatParameters& parameters, const ControllerHostOptions& options);
  ~ControllerHost();
  ControllerHost(const ControllerHost&) = delete;

  // Full names of the interfaces, in the order of states() and commands().
  const std::vector<std::string>& state_names() const;
  const std::vector<std::string>& command_names() const;
  std::span<double> states();
  std::span<const double> commands() const;

  // Host's loop. Call with states() filled. Returns an empty string, or the reason why it did not start.
  std::string activate();
  // Reads states(), writes commands(). Returns false if the hardware behind a robot_state has gone; the
  // commands are then invalid.
  bool update(double period_s) noexcept;
  void deactivate() noexcept;

  // Any thread but the loop's.
  struct Parameter {
    rcl_interfaces::msg::ParameterDescriptor descriptor;
    rcl_interfaces::msg::ParameterValue value;
  };
  std::vector<Parameter> parameters() const;  // of controllets and features: "pose0.stiffness_n_per_m"
  bool has_parameter(const std::string& name) const;
  // Sets all or none, in one cycle. Returns an empty string, or the reason for a refusal.
  std::string set_parameters(const std::vector<rcl_interfaces::msg::Parameter>& parameters);
  std::vector<std::string> active() const;  // active controllets, without the holds

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda::ros
