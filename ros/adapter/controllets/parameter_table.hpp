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
// Numbers are doubles (integers are taken as well), vectors double arrays (one number means all of them),
// switches bools, choices strings (their numbers from 0 are taken as well). Knows no node: whoever has one
// declares or serves them. Any thread but the loop's.
class ParameterTable {
 public:
  explicit ParameterTable(MultimodeController& modes) : modes_(&modes) {}

  using Value = rcl_interfaces::msg::ParameterValue;
  using Descriptor = rcl_interfaces::msg::ParameterDescriptor;

  std::vector<std::string> names() const;
  bool has(std::string_view name) const { return find(name).has_value(); }
  // Of names that do not exist: type PARAMETER_NOT_SET, as ROS does.
  Descriptor describe(const std::string& name) const;
  Value get(const std::string& name) const;
  // As rcl_interfaces/srv/ListParameters says; depth 0: all below.
  rcl_interfaces::msg::ListParametersResult list(const std::vector<std::string>& prefixes,
                                                 std::uint64_t depth) const;

  // The request that sets it, checked as far as that needs no loop; nothing: `reason` says why not.
  std::optional<Request> request(const rcl_interfaces::msg::Parameter& parameter, std::string& reason) const;
  // What an event of the kind parameter_set set.
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
