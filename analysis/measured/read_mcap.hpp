#pragma once

#include "analysis/measured/measured_log.hpp"

namespace multipanda {

// All arms (or options.arm) of one of our logs, unchecked, completed from the scene in it. Throws LogRefused,
// std::invalid_argument if there is no such arm.
std::vector<MeasuredLog> read_mcap(const std::filesystem::path& path, const MeasuredLogOptions& options);

}  // namespace multipanda
