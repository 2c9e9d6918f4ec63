#pragma once

#include <span>
#include <vector>

#include "core/types/spatial.hpp"

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

// Roll, pitch, yaw of a rotation, the inverse of rotation_from_rpy [rad]. At a pitch of pi/2 roll is 0.
Vector3 rpy_of(const Matrix3& R);

}  // namespace multipanda::commission
