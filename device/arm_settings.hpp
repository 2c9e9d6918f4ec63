#pragma once

#include <memory>
#include <string>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"

namespace multipanda {

// Settings of an arm: frames, loads, stiffnesses of its own controllers, contact thresholds, guiding.
struct ArmSettings {
  ArmFrames frames;
  Load tool, load;
  JointVector joint_stiffness;        // of the arm's own joint controller [N m/rad] (n x 1)
  Vector6 cartesian_stiffness;        // of the arm's own Cartesian controller, in K [N/m, N m/rad]
  SetCollisionThresholds thresholds;  // contact and reflex
  SetGuidingMode guiding;             // free axes while the guiding buttons are pressed
};

// Franka's default stiffnesses; thresholds at the model's torque limits and 100 N, 100 N m; guiding
// in all axes.
ArmSettings default_settings(const ArmModel& model);

// Why the load is invalid, or an empty string.
std::string check_load(const Load& load);
// Why a request to an arm of `joint_count` joints is invalid, or an empty string.
std::string check_request(const ArmRequest& request, std::size_t joint_count);

}  // namespace multipanda
