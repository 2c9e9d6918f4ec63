#pragma once

#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "arm_interface/arm_interface.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/executor.hpp"

namespace multipanda::ros {

inline constexpr double kArmTimeout = kRequestPatience + kRequestSlack;  // for a backend's answer [s]
inline constexpr double kGripperTimeout = 600;  // for the end of a gripper's motion [s]

// Sends a request to the backend and calls `answered` once on the executor's thread: with the answer, or
// after `timeout_s` without one. Executor's thread; never waits. Objects that `answered` uses must
// outlive it. The executor of requests that end a motion is AdapterContext::stops.
void request_arm(const AdapterContext& run, ArmIndex arm, ArmRequest request, double timeout_s,
                 std::function<void(const RequestAnswer&)> answered);
void request_arm(const AdapterContext& run, ArmIndex arm, GripperRequest request, double timeout_s,
                 std::function<void(const RequestAnswer&)> answered);

// Thresholds that a service may set: the scene's; otherwise the careful ones on a real arm and the largest
// useful ones in simulation.
SetCollisionThresholds most_thresholds(const AdapterContext& run, ArmIndex arm);

// Services of one arm that its backend answers: recovery, loads, frames, stiffnesses, contact thresholds,
// guiding, vacuum gripper.
// Those that multipanda_ros2 has also have its names.
class ArmServices : public AdapterPart {
 public:
  ArmServices(const AdapterContext& run, ArmIndex arm);

 private:
  // Offers service S under the arm's name and, if `alias` is not empty, under the alias. `read` may throw
  // std::invalid_argument, which refuses the request.
  template <class S, class Request = ArmRequest>
  void offer(const std::string& name, const std::string& alias, const std::string& doc,
             std::type_identity_t<std::function<Request(const typename S::Request&)>> read,
             double timeout_s = kArmTimeout, Executor* executor = nullptr);
  void offer_vacuum();

  const AdapterContext& run_;
  const ArmIndex arm_;
  std::vector<std::unique_ptr<Incoming>> services_;
};

}  // namespace multipanda::ros
