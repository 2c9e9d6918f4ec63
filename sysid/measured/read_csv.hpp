#pragma once

#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// One arm from a CSV file, unchecked. Throws LogRefused.
MeasuredLog read_csv(const std::filesystem::path& path, const MeasuredLogOptions& options);

}  // namespace multipanda
