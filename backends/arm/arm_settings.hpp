#pragma once

#include <memory>
#include <string>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"

namespace multipanda {

// What the user has set on the arm, and the arm's own limits of contact.
struct ArmSettings {
  ArmFrames frames;
  Load tool, load;
  JointVector joint_stiffness;        // of the arm's own joint controller [N m/rad] (n x 1)
  Vector6 cartesian_stiffness;        // of the arm's own Cartesian controller, in K [N/m, N m/rad]
  SetCollisionThresholds thresholds;  // contact and reflex
  SetGuidingMode guiding;             // what gives way while the buttons for guiding are pressed
};

// The maker's default stiffnesses; thresholds at the model's torque limits and 100 N, 100 N m; guiding in all
// axes. Sizes follow the joint count.
ArmSettings default_settings(const ArmModel& model);

// Why no such load can hang on an arm, or nothing.
std::string check_load(const Load& load);
// Why a request to an arm of n joints cannot be meant, or nothing.
std::string check_request(const ArmRequest& request, std::size_t joint_count);

}  // namespace multipanda
