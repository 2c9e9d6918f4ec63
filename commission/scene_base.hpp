#pragma once

#include <string>

#include "core/types/spatial.hpp"

namespace multipanda::commission {

// The text of a scene with another base of the named arm; everything else, also comments of other lines, may
// be laid out differently. Throws std::invalid_argument: no such arm.
std::string with_base(const std::string& scene_text, const std::string& arm, const Pose& X_WB,
                      const std::string& note);

}  // namespace multipanda::commission
