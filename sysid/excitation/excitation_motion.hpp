#pragma once

#include "core/reference/harmonic.hpp"
#include "core/types/joints.hpp"

namespace multipanda {

// A motion of all joints of an arm that begins and ends at rest in `q_start`.
struct ExcitationMotion {
  JointVector q_start;  // [rad] (n x 1)
  Harmonic series;

  struct Sample {
    JointVector q, dq, ddq;  // (n x 1) [rad], [rad/s], [rad/s^2]
  };
  double duration() const { return series.duration(); }
  std::size_t parts() const { return series.harmonic_count + 1; }
  // Set-point at t from the motion's start, bit-identical to a run's reference.
  Sample at(double t) const;
};

// The motion as a search sees it: q_start, then sine and rise per harmonic and joint, (n (1 + 2 parts) x 1).
// Everything else (period, ramp) stays as in `shape`.
Eigen::VectorXd coefficients_of(const ExcitationMotion& motion);
ExcitationMotion with_coefficients(const ExcitationMotion& shape, const Eigen::VectorXd& coefficients);

}  // namespace multipanda
