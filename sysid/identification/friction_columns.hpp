#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"

// Friction laws whose torque is linear in one amplitude per joint, as a torque sensor shows them.
namespace multipanda {

enum class FrictionKind {
  offset,        // 1
  viscous,       // dq
  stribeck,      // tanh(dq / 0.01) exp(-(dq / 0.3)^2)
  coulomb,       // tanh(dq / 0.05)
  sigmoid,       // the shape of the robot's table without its p1
  presliding,    // z / s with Dahl's state z (PreslidingElement)
  acceleration,  // ddq: an inertia about the joint that no link explains
};

struct FrictionPart {
  FrictionKind kind = FrictionKind::offset;
  double distance = 0;  // presliding only [rad]
  bool operator==(const FrictionPart&) const = default;
};

std::string to_string(const FrictionPart& part);  // "presliding 3 mrad"
std::string unit_of(const FrictionPart& part);    // of its amplitude
bool has_sign(const FrictionPart& part);          // its amplitude must be >= 0, otherwise it would add energy

// A presliding state starts at 0 for a resting joint. For a moving joint it starts as if the joint had come
// 0.2 rad from rest in the same direction, since no log has what was before it.

// Column of one part for every joint, at 1 ms, before any filter. dq, ddq (N x n) -> (N x n).
// `table` is the robot's, for `sigmoid`; throws std::invalid_argument if it is needed and there is none.
Eigen::MatrixXd friction_column(const FrictionPart& part, const Eigen::MatrixXd& dq,
                                const Eigen::MatrixXd& ddq, const std::optional<JointFriction>& table,
                                double dt);

// Friction torque of a law along a motion at steps of dt, before any filter (N x n) [N m].
Eigen::MatrixXd friction_torque(const FrictionLaw& law, const Eigen::MatrixXd& dq, double dt);
// The same for a table: p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)).
Eigen::MatrixXd friction_torque(const JointFriction& table, const Eigen::MatrixXd& dq);

}  // namespace multipanda
