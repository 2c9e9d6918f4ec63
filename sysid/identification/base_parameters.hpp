#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"

// Which combinations of inertial parameters can be identified from torques. Columns of the regressor that
// depend on others for every motion (Gautier, Khalil, IEEE T-RA 1990, doi 10.1109/70.56655; numerically:
// Gautier, J. Robotic Systems 1991) are expressed by those, so that  Y theta = Y_base beta,  beta = C theta.
namespace multipanda {

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

// By rank-revealing QR of the column-scaled regressor at seeded random states inside the arm's range: the
// structure of the arm, the same for all data. With several gravities, of the mountings that it moves in,
// more is identifiable than with one. Equal ones count once; none: a level base.
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
