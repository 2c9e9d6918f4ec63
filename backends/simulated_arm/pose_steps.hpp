#pragma once

#include "core/types/spatial.hpp"

// Small motions between poses, and checks of pose matrices. No allocation.
namespace multipanda {

// [p - p_before; rotation vector of R R_before^T], axes of the frame that both are given in [m, rad]. From
// the skew part: errors of orthonormality in either, like those of single precision, do not reach it.
Vector6 pose_difference(const Pose& X, const Pose& X_before);

// The pose that differs from X by dX in that sense.
Pose displaced(const Pose& X, const Vector6& dX);

// The rotation nearest to R, which must be within about 0.1 of one: two steps of Newton's iteration for the
// polar factor, error 1e-5 -> 1e-20.
Matrix3 nearest_rotation(Matrix3 R);

// How far T is from a right-handed rotation and a last row 0 0 0 1: by lengths of rows and columns, as
// Franka's client checks it before sending, with the same tolerance. 1 or more: not a frame.
double error_of_frame(const Eigen::Matrix4d& T);

}  // namespace multipanda
