#pragma once

#include <functional>

#include "ros/adapter/part.hpp"

namespace multipanda::ros {

inline constexpr double kArmPatience = 5;        // for a backend's answer [s]
inline constexpr double kGripperPatience = 600;  // for the end of a gripper's motion [s]

// Asks the backend and calls `answered` on the executor's thread, once, when the answer is there or after
// `patience_s` without one. Executor's thread; never waits. What `answered` uses must live as long as it.
void ask_arm(const AdapterWorld& world, ArmIndex arm, ArmRequest request, double patience_s,
             std::function<void(const ArmAnswer&)> answered);

// Counts a request in the adapter's counters.
void count_request(const AdapterWorld& world, bool success);

}  // namespace multipanda::ros
