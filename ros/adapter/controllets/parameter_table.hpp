#pragma once

#include <cstdint>
#include <optional>
#include <rcl_interfaces/msg/list_parameters_result.hpp>
#include <rcl_interfaces/msg/parameter.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rcl_interfaces/msg/parameter_value.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "core/modes/multimode_controller.hpp"

namespace multipanda::ros {

// All parameters of all controllets and their features as ROS parameters:
//   <instance>.<parameter>             "pose0.stiffness_n_per_m"
//   <instance>.<feature>.<parameter>   "pose0.joint_limits.range_rad"
// Numbers are doubles (integers are accepted), vectors are double arrays (one number sets all elements),
// switches are bools, choices are strings (their numbers from 0 are accepted). Needs no node; the caller
// declares or serves the parameters. Any thread but the loop's.
class ParameterTable {
 public:
  explicit ParameterTable(MultimodeController& modes) : modes_(&modes) {}

  using Value = rcl_interfaces::msg::ParameterValue;
  using Descriptor = rcl_interfaces::msg::ParameterDescriptor;

  std::vector<std::string> names() const;
  bool has(std::string_view name) const { return find(name).has_value(); }
  // Unknown names have the type PARAMETER_NOT_SET, as in ROS.
  Descriptor describe(const std::string& name) const;
  Value get(const std::string& name) const;
  // As rcl_interfaces/srv/ListParameters; depth 0 lists all levels.
  rcl_interfaces::msg::ListParametersResult list(const std::vector<std::string>& prefixes,
                                                 std::uint64_t depth) const;

  // Returns the request that sets the parameter, after all checks that do not need the loop. On failure
  // returns nothing and fills `reason`.
  std::optional<Request> request(const rcl_interfaces::msg::Parameter& parameter, std::string& reason) const;
  // Returns the parameter that an event of the kind parameter_set has set.
  rcl_interfaces::msg::Parameter changed(const Event& event) const;

 private:
  struct Place {
    InstanceIndex instance;
    std::size_t index;
  };
  std::optional<Place> find(std::string_view name) const;
  std::string name_of(const Place& place) const;
  Value value_of(const Place& place, const std::vector<double>& numbers) const;
  std::optional<std::vector<double>> numbers_in(const Value& value, const Place& place,
                                                std::string& reason) const;

  MultimodeController* modes_;
};

}  // namespace multipanda::ros
