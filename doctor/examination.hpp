#pragma once

#include <functional>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

struct ExaminationOptions {
  std::vector<std::string> addresses;  // of arms
  std::string scene;                   // whose control cycle is timed
  double seconds = 10;                 // of each measurement
};

// Real arms, as soon as one address is none of this computer's own.
Purpose purpose_of(const std::vector<std::string>& addresses);

// All examinations, one after the other; each finding is shown as soon as it is there. Moves no arm. Takes
// about (1 + 2 * arms) times `seconds`. What cannot be read is a finding, never an exception.
std::vector<Finding> examine(const ExaminationOptions& options,
                             const std::function<void(const Finding&)>& show);

}  // namespace multipanda::doctor
