#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/modes/multimode_controller.hpp"

// What became of a request, in words: the same ones on every way into a run (socket, ROS). Off the loop.
namespace multipanda {

std::string_view name_of(Verdict verdict);  // "two_owners"

std::vector<std::string> names_of(const MultimodeController& modes, InstanceSet set);
std::vector<std::string> names_of(const MultimodeController& modes, ArmSet arms);
std::vector<std::string> instance_names(const MultimodeController& modes);

// Why a request was not accepted, and what to do.
std::string reason(const MultimodeController& modes, const Request& request, Verdict verdict);

// For names that do not exist: what was given, and what was probably meant.
std::string no_such_controllet(const MultimodeController& modes, const std::string& name);
std::string no_such_arm(const MultimodeController& modes, const std::string& name);
std::string no_such_feature(const Instance& instance, const std::string& name);
std::string no_such_parameter(const Instance& instance, const std::string& name);

}  // namespace multipanda
