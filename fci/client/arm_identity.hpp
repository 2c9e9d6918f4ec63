#pragma once

#include <string>

namespace multipanda::fci {

// What a connected arm reports about itself.
struct ArmIdentity {
  int version = 0;         // of the protocol
  std::string generation;  // "FR3", "Panda"
  bool model_checked = false;
  std::string model_report;  // the result of the comparison of the models, or why there was none
};

}  // namespace multipanda::fci
