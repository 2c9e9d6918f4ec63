#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <rcl_interfaces/msg/list_parameters_result.hpp>
#include <rcl_interfaces/msg/parameter.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rcl_interfaces/msg/parameter_event.hpp>
#include <rcl_interfaces/msg/parameter_value.hpp>
#include <rcl_interfaces/srv/describe_parameters.hpp>
#include <rcl_interfaces/srv/get_parameter_types.hpp>
#include <rcl_interfaces/srv/get_parameters.hpp>
#include <rcl_interfaces/srv/list_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters_atomically.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "core/modes/multimode_controller.hpp"
#include "core/modes/request.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/rcl.hpp"

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

// The parameter services of a node, as `ros2 param` and every client library know them, for a ParameterTable.
// set_parameters sets the valid values, one by one; set_parameters_atomically sets all or none, in the same
// cycle. /parameter_events reports every change, whatever caused it.
class ParameterServices : public AdapterPart {
 public:
  explicit ParameterServices(const AdapterContext& run);
  void take(const Event& event) override;

 private:
  using Results = std::vector<rcl_interfaces::msg::SetParametersResult>;
  // Posts the valid values, then calls `done` on the executor's thread with one result per parameter.
  // `all_or_none`: posts one batch, and nothing if one value is invalid; otherwise as many batches as needed.
  void set(const std::vector<rcl_interfaces::msg::Parameter>& parameters, bool all_or_none,
           std::function<void(Results)> done);
  struct Job;
  void set_next(const std::shared_ptr<Job>& job);

  const AdapterContext& run_;
  ParameterTable table_;
  Publisher<rcl_interfaces::msg::ParameterEvent> events_;
  Service<rcl_interfaces::srv::DescribeParameters> describe_;
  Service<rcl_interfaces::srv::GetParameters> get_;
  Service<rcl_interfaces::srv::GetParameterTypes> types_;
  Service<rcl_interfaces::srv::ListParameters> list_;
  Service<rcl_interfaces::srv::SetParameters> set_;
  Service<rcl_interfaces::srv::SetParametersAtomically> set_atomically_;
};

// The loop's answer to a batch of requests.
struct LoopAnswer {
  Answer answer;                  // to the last request; after a timeout without times
  std::vector<Verdict> verdicts;  // one per request
  // Index of the first refused request; the number of requests if there is none.
  std::size_t first_refused() const;
};

// Posts the requests for one cycle and calls `done` on the executor's thread: at once if a request is invalid
// (all get the verdict of the first invalid one), otherwise when the loop has answered, or after 1 s without
// an answer: they are then withdrawn and will not be executed. Executor's thread; never waits.
void request_loop(const AdapterContext& run, const std::vector<Request>& requests,
                  std::function<void(const LoopAnswer&)> done);

}  // namespace multipanda::ros
