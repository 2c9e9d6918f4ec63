#pragma once

#include <cstdint>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/modes/multimode_controller.hpp"

// Texts for results of requests, shared by all clients of a run. Not for the loop's thread.
namespace multipanda {

std::vector<std::string> names_of(const MultimodeController& modes, InstanceSet set);
std::vector<std::string> names_of(const MultimodeController& modes, ArmSet arms);
std::vector<std::string> instance_names(const MultimodeController& modes);

// Why a request was refused, and what to do. `rule`: Answer::rule.
std::string reason(const MultimodeController& modes, const Request& request, Verdict verdict,
                   Intervention rule = Intervention::none);

// Sends a request to an arm of the run. A load is refused here while the arm is stopped or guided by hand,
// because a wrong one would move it; a motion of the gripper while its arm is stopped, also by its button or
// a reflex, because a hand may be between its fingers. `mode`: of the arm, as in its samples.
std::future<RequestAnswer> request_arm(const MultimodeController& modes, Backend& backend, ArmIndex arm,
                                       ArmRequest request);
std::future<RequestAnswer> request_arm(const MultimodeController& modes, Backend& backend, ArmIndex arm,
                                       GripperRequest request, std::uint8_t mode);
// Whether an arm is stopped and ends its gripper's motion.
bool gripper_stops(const MultimodeController& modes, ArmIndex arm, std::uint8_t mode);
// The request that ends the motion that `request` begins. None for a firmer grasp of a held object, which
// would fall.
std::optional<GripperRequest> ending_of(const GripperRequest& request, bool grasped);

// Messages for unknown names, with the nearest valid one.
std::string no_such_controllet(const MultimodeController& modes, const std::string& name);
std::string no_such_arm(const MultimodeController& modes, const std::string& name);
std::string no_such_feature(const Instance& instance, const std::string& name);
std::string no_such_parameter(const Instance& instance, const std::string& name);
std::string no_such_input(const Instance& instance, const std::string& name);

}  // namespace multipanda
