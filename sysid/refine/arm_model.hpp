#pragma once

#include <span>

#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "sysid/measured/measured_log.hpp"
#include "sysid/refine/refine.hpp"

namespace multipanda {

struct ArmModelOptions {
  std::string family;          // of friction beyond the torque sensor; empty: chosen by cross-validation
  std::filesystem::path file;  // output file
  std::size_t threads = 2;
};

// Identifies one arm from its logs: masses, friction and tilt from torque at the sensor; delay, bandwidth and
// friction before the sensor from commanded torque. Writes a model file. Throws LogRefused.
RefinedArm identify_arm(const SceneArm& arm, const RobotDescription& prior, std::span<const MeasuredLog> logs,
                        const ArmModelOptions& options);

std::string in_words(const RefinedArm& arm);  // one human-readable line

}  // namespace multipanda
