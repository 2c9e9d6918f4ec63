#pragma once

#include <array>

#include <Eigen/Core>

#include "models/rigid_body.hpp"

// The ten inertial parameters of a body, in the order of Pinocchio and about the origin of the body's frame:
//   theta = (m, m cx, m cy, m cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)
// and the pseudo-inertia, which is linear in them:  P = [[S, m c], [m c^T, m]],  S = tr(I)/2 1 - I.
// Some distribution of positive mass has these parameters if and only if P is positive definite (Wensing,
// Kim, Slotine, IEEE RA-L 2018, doi 10.1109/LRA.2017.2729659).
namespace multipanda {

using Theta = Eigen::Matrix<double, 10, 1>;
inline constexpr std::array<const char*, 10> kThetaNames{"m",   "mx",  "my",  "mz",  "Ixx",
                                                         "Ixy", "Iyy", "Ixz", "Iyz", "Izz"};

Theta theta_of(const RigidBody& body);
RigidBody body_of(const Theta& theta);  // mass above zero
Eigen::Matrix4d pseudo_inertia(const Theta& theta);

// The body with every eigenvalue of its second moment about the center of mass at least `floor` [kg m^2].
RigidBody floored(const RigidBody& body, double floor);

// Distance of a body to a prior: the log-det divergence of pseudo-inertias,
//   d(P) = tr(P0^-1 P) - log det(P0^-1 P) - 4,
// convex in theta, zero at the prior, infinite where P is not positive definite.
class Divergence {
 public:
  explicit Divergence(const Theta& prior);
  // If the value is infinite, gradient and Hessian are not changed. With null pointers it computes
  // only the value.
  double value(const Theta& theta, Theta* gradient = nullptr,
               Eigen::Matrix<double, 10, 10>* hessian = nullptr) const;

 private:
  Eigen::Matrix4d inverse_;
  Theta trace_;  // tr(P0^-1 dP/dtheta_k)
  double log_det_ = 0;
};

}  // namespace multipanda
