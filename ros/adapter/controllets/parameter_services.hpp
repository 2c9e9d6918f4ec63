#pragma once

#include <memory>
#include <rcl_interfaces/msg/parameter_event.hpp>
#include <rcl_interfaces/srv/describe_parameters.hpp>
#include <rcl_interfaces/srv/get_parameter_types.hpp>
#include <rcl_interfaces/srv/get_parameters.hpp>
#include <rcl_interfaces/srv/list_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters_atomically.hpp>
#include <vector>

#include "ros/adapter/controllets/parameter_table.hpp"
#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// The parameter services of a node, as `ros2 param` and every client library know them, on a ParameterTable.
// set_parameters sets what it can, one by one; set_parameters_atomically sets all or none, in the same cycle.
// /parameter_events tells of every change, whoever made it.
class ParameterServices : public Part {
 public:
  explicit ParameterServices(const AdapterWorld& world);
  void take(const Event& event) override;

 private:
  using Results = std::vector<rcl_interfaces::msg::SetParametersResult>;
  // Posts what is right of it, then calls `done` on the executor's thread with one result per parameter.
  // `all_or_none`: in one batch, and nothing is posted if one is wrong; else in as many batches as it takes.
  void set(const std::vector<rcl_interfaces::msg::Parameter>& parameters, bool all_or_none,
           std::function<void(Results)> done);
  struct Job;
  void set_next(const std::shared_ptr<Job>& job);

  const AdapterWorld& world_;
  ParameterTable table_;
  Publisher<rcl_interfaces::msg::ParameterEvent> events_;
  Service<rcl_interfaces::srv::DescribeParameters> describe_;
  Service<rcl_interfaces::srv::GetParameters> get_;
  Service<rcl_interfaces::srv::GetParameterTypes> types_;
  Service<rcl_interfaces::srv::ListParameters> list_;
  Service<rcl_interfaces::srv::SetParameters> set_;
  Service<rcl_interfaces::srv::SetParametersAtomically> set_atomically_;
};

}  // namespace multipanda::ros
