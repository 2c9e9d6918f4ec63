#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"

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

// Which combinations of inertial parameters can be identified from torques. Columns of the regressor that
// depend on others for every motion (Gautier, Khalil, IEEE T-RA 1990, doi 10.1109/70.56655; numerically:
// Gautier, J. Robotic Systems 1991) are expressed by those, so that  Y theta = Y_base beta,  beta = C theta.

struct BaseParameters {
  Eigen::MatrixXd combination;              // C (r x 10 n)
  std::vector<Eigen::Index> leading;        // the entry of theta that each represents: Y_base = Y(:, leading)
  std::vector<std::string> names;           // "link2 mx - 0.316 link3 m ..."
  std::vector<std::string> alone;           // parameters that are identifiable by themselves
  std::vector<std::string> combined;        // parameters that are identifiable in combination only
  std::vector<std::string> unidentifiable;  // parameters on which no torque depends
  std::vector<Eigen::Index> unidentifiable_entries;  // their entries of theta
  Eigen::Index rank() const { return combination.rows(); }
};

// By rank-revealing QR of the column-scaled regressor at seeded random states inside the arm's range: a
// property of the arm, independent of the data. With several directions of gravity (one per mounting) more is
// identifiable than with one. Equal ones count once; none: a level base.
BaseParameters base_parameters(const RobotDescription& robot, std::span<const Vector3> gravities_B = {});

// How well a regressor's columns (m x r) can be distinguished: largest over smallest singular value, as it is
// and with every column brought to length 1. Infinite for a column of zeros.
struct Condition {
  double raw = 0, scaled = 0;
};
Condition condition_of(const Eigen::MatrixXd& regressor);

std::string theta_name(Eigen::Index column);  // name of an entry of theta (10 n): "link1 m"
std::string theta_unit(Eigen::Index column);  // its unit: "kg"

}  // namespace multipanda
