#pragma once

#include <functional>
#include <optional>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

struct ExaminationOptions {
  std::vector<std::string> addresses;  // of arms
  std::string scene;                   // whose control cycle is timed
  double seconds = 10;                 // of each measurement
  std::optional<Purpose> purpose;      // of the computer; none: by the addresses
};

// Real arms if an address belongs to another computer.
Purpose purpose_of(const std::vector<std::string>& addresses);

// Runs all examinations in order and shows each finding at once. Moves no arm. Takes about (1 + 2 * arms)
// times `seconds`. Unreadable quantities become findings, not exceptions.
std::vector<Finding> examine(const ExaminationOptions& options,
                             const std::function<void(const Finding&)>& show);

}  // namespace multipanda::doctor
