#pragma once

#include <functional>

#include "arm_interface/request_patience.hpp"
#include "ros/adapter/adapter_part.hpp"

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

}  // namespace multipanda::ros
