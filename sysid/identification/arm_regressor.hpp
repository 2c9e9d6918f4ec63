#pragma once

#include <memory>

#include <Eigen/Core>

#include "models/robot_description.hpp"

namespace multipanda {

// Rigid-body torque of one arm as a linear function of the inertial parameters of its moving links:
//   M ddq + c + g = Y(q, dq, ddq) theta,  theta (10 n), ten per moving link in its own frame, link1 first.
// Gravity is a vector in the base frame, so any mounting and tilt is possible. One instance per thread.
class ArmRegressor {
 public:
  explicit ArmRegressor(const RobotDescription& robot);  // only its kinematics are used
  ~ArmRegressor();
  ArmRegressor(ArmRegressor&&) noexcept;

  Eigen::Index joints() const;
  // (n x 10 n); valid until the next call.
  const Eigen::MatrixXd& at(const Eigen::VectorXd& q, const Eigen::VectorXd& dq, const Eigen::VectorXd& ddq,
                            const Vector3& gravity_B);
  // The contribution of gravity alone, per unit of a field in direction `field_B` (n x 10 n).
  const Eigen::MatrixXd& of_field(const Eigen::VectorXd& q, const Vector3& field_B);

 private:
  struct Engine;
  std::unique_ptr<Engine> engine_;
};

// theta of every moving link (10 n).
Eigen::VectorXd thetas_of(const RobotDescription& robot);

// Hand (if `hand`) and tool as one body in the frame of the last link. Throws std::invalid_argument if `hand`
// is set and the robot has none.
std::optional<RigidBody> known_body(const RobotDescription& robot, bool hand,
                                    const std::optional<RigidBody>& tool);

// Gravity in the frame of a base tilted by RobotDescription::base_tilt, and its derivative by each angle at
// zero tilt.
Vector3 tilted(const Vector3& gravity_B, const Eigen::Vector2d& tilt);
Eigen::Matrix<double, 3, 2> tilt_directions(const Vector3& gravity_B);

}  // namespace multipanda
