#pragma once

#include <string>

#include "fci/server/virtual_arms.hpp"

namespace multipanda::fci {

// Executes one line, such as `loss left 0.1`, and answers with one line: "ok", or what was expected.
// control_help() lists the commands. Any thread.
std::string control(VirtualArms& arms, const std::string& line);
std::string control_help();

}  // namespace multipanda::fci
