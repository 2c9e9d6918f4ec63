#pragma once

#include <span>
#include <string>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "scene/scene.hpp"

namespace multipanda::commission {

// The mean of an arm's measurements at rest.
struct RestSample {
  JointVector q;      // [rad] (n x 1)
  JointVector tau_J;  // link-side torque with gravity [N m] (n x 1)
};

// What the torques at rest say about the mounting of the base and the load of the flange, against the scene.
// Both explanations are fitted to the same difference; `text` names the better one.
struct GravityFit {
  double largest_nm = 0;  // |tau_J - g| of any joint, with the scene's base, tool and declared load
  int joint = 0;          // which, from 0
  double rms_nm = 0;      // of all differences
  // A base that is turned: the direction of gravity in the base, free.
  Vector3 gravity_B = Vector3::Zero();  // [m/s^2]
  double tilt_rad = 0;                  // from the scene's direction
  double tilt_rms_nm = 0;               // what it leaves unexplained
  // A body on the flange beyond tool and declared load; negative: less than declared.
  double mass_kg = 0;
  Vector3 moment_kg_m =
      Vector3::Zero();  // mass times center in the flange; one part of it is unknown in one pose
  double load_rms_nm = 0;

  bool load_explains() const { return load_rms_nm <= tilt_rms_nm; }
  std::string text() const;
};

// Rotation about a vertical axis cannot be seen in gravity. Throws std::invalid_argument: no samples, another
// number of joints.
GravityFit fit_gravity(const SceneArm& arm, std::span<const RestSample> samples);

}  // namespace multipanda::commission
