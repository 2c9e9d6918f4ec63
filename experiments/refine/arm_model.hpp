#pragma once

#include <span>

#include "analysis/measured/measured_log.hpp"
#include "experiments/refine/refine.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

struct ArmModelOptions {
  std::string family;          // of friction beyond the torque sensor; empty: chosen by cross-validation
  std::filesystem::path file;  // to write
  std::size_t threads = 2;
};

// What the logs of one arm say of it: masses, friction and tilt from torque at the sensor, delay, bandwidth
// and friction before the sensor from commanded torque. Written as a model file. Throws LogRefused.
RefinedArm identify_arm(const SceneArm& arm, const RobotDescription& prior, std::span<const MeasuredLog> logs,
                        const ArmModelOptions& options);

std::string in_words(const RefinedArm& arm);  // one line

}  // namespace multipanda
