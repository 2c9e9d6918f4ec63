#pragma once

#include <functional>
#include <memory>
#include <rcl_interfaces/msg/parameter_event.hpp>
#include <rcl_interfaces/srv/describe_parameters.hpp>
#include <rcl_interfaces/srv/get_parameter_types.hpp>
#include <rcl_interfaces/srv/get_parameters.hpp>
#include <rcl_interfaces/srv/list_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters.hpp>
#include <rcl_interfaces/srv/set_parameters_atomically.hpp>
#include <vector>

#include "core/modes/request.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/parameter_table.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

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
