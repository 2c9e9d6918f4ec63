#pragma once

#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// All arms (or options.arm) of one of our logs, unchecked, completed from the scene in it. Throws LogRefused,
// and std::invalid_argument for an unknown arm.
std::vector<MeasuredLog> read_mcap(const std::filesystem::path& path, const MeasuredLogOptions& options);

}  // namespace multipanda
