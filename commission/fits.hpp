#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "scene/scene.hpp"

namespace multipanda::commission {

// The rigid transform between two lists of the same points, and how well it fits.
struct RigidFit {
  Pose X_AB;                       // p_A = X_AB * p_B
  std::vector<double> residual_m;  // of each point
  double rms_m = 0;                // over the points
  // Root mean square distance of the points from the line that fits them best: with a small width the
  // rotation about that line is unknown.
  double width_m = 0;
  // Standard deviation of the rotation about that line, from the residual [rad]; infinite: collinear points.
  double angle_rad = 0;
};

// Least squares over rotations and translations (Kabsch 1976, by singular values; a reflection is excluded).
// Throws std::invalid_argument: different counts, fewer than three points, a number that is not finite.
RigidFit fit_rigid(std::span<const Vector3> points_A, std::span<const Vector3> points_B);

// The mean of an arm's measurements at rest.
struct RestSample {
  JointVector q;      // [rad] (n x 1)
  JointVector tau_J;  // link-side torque with gravity [N m] (n x 1)
};

// Torques at rest compared with the scene, explained by the mounting of the base or the load on the flange.
// Both are fitted to the same difference; `text` names the better one.
struct GravityFit {
  double largest_nm = 0;  // |tau_J - g| of any joint, with the scene's base, tool and declared load
  int joint = 0;          // its index, from 0
  double rms_nm = 0;      // of all differences
  // A turned base: direction of gravity in the base.
  Vector3 gravity_B = Vector3::Zero();  // [m/s^2]
  double tilt_rad = 0;                  // from the scene's direction
  double tilt_rms_nm = 0;               // remaining difference
  // A body on the flange beyond tool and declared load; negative: less than declared.
  double mass_kg = 0;
  // Mass times center in the flange; one component of it is unknown in one pose.
  Vector3 moment_kg_m = Vector3::Zero();
  double load_rms_nm = 0;

  bool load_explains() const { return load_rms_nm <= tilt_rms_nm; }
  std::string text() const;
};

// Rotation about a vertical axis has no effect on gravity. Throws std::invalid_argument: no samples, another
// number of joints.
GravityFit fit_gravity(const SceneArm& arm, std::span<const RestSample> samples);

}  // namespace multipanda::commission
