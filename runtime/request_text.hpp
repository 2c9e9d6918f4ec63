#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/modes/multimode_controller.hpp"

// Human-readable results of requests, the same for socket and ROS. Not for the loop's thread.
namespace multipanda {

std::vector<std::string> names_of(const MultimodeController& modes, InstanceSet set);
std::vector<std::string> names_of(const MultimodeController& modes, ArmSet arms);
std::vector<std::string> instance_names(const MultimodeController& modes);

// Why a request was refused, and what to do.
std::string reason(const MultimodeController& modes, const Request& request, Verdict verdict);

// Messages for unknown names, with the nearest valid one.
std::string no_such_controllet(const MultimodeController& modes, const std::string& name);
std::string no_such_arm(const MultimodeController& modes, const std::string& name);
std::string no_such_feature(const Instance& instance, const std::string& name);
std::string no_such_parameter(const Instance& instance, const std::string& name);

}  // namespace multipanda
