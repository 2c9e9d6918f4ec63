#pragma once

#include <vector>

#include <Eigen/Core>

#include "core/types/joints.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// Inverse dynamics of a chain as a matrix times its links' parameters, tau = Y(q, dq, ddq) phi. Each moving
// link has [m, m c_x, m c_y, m c_z, Ixx, Ixy, Iyy, Ixz, Iyz, Izz] in its frame, inertia about the frame's
// origin. Newton-Euler per link, projected on the joints' axes:
//   f = m a + alpha x mc + omega x (omega x mc),  n = mc x a + I alpha + omega x I omega,
// with a the acceleration of the frame's origin less gravity. One instance per thread.
class DynamicsRegressor {
 public:
  // Level base, gravity 9.81 m/s^2 along its -z. The last link includes what is behind it (hand, tool).
  explicit DynamicsRegressor(const RobotDescription& robot);

  std::size_t joints() const { return X_.size(); }
  // Y (n x 10 n). All vectors (n x 1) [rad], [rad/s], [rad/s^2].
  const Eigen::MatrixXd& evaluate(const JointVector& q, const JointVector& dq, const JointVector& ddq);

 private:
  std::vector<Pose> X_;  // of joint frames at zero, in the preceding link
  std::vector<Vector3> p_, z_;
  Eigen::MatrixXd Y_;
};

// phi of a robot's links (10 n x 1); the last one includes the hand, if the robot has one and `hand` is set.
Eigen::VectorXd link_parameters(const RobotDescription& robot, bool hand);

// How well motions distinguish the base parameters of a robot: the condition number of the
// regressor's independent columns, each scaled to unit length over the motion. 1 would be perfect.
// One instance per thread.
class BaseCondition {
 public:
  // Finds the independent columns at random states (fixed seed): as many as the chain has base parameters.
  explicit BaseCondition(const RobotDescription& robot);

  std::size_t parameters() const { return columns_.size(); }
  const std::vector<Eigen::Index>& columns() const { return columns_; }  // of the whole regressor
  void begin();                                                          // discards the samples
  void add(const JointVector& q, const JointVector& dq, const JointVector& ddq);
  double value() const;  // of the samples so far; infinite if a column is zero in all of them

 private:
  DynamicsRegressor regressor_;
  std::vector<Eigen::Index> columns_;
  Eigen::MatrixXd chosen_, gram_;
};

}  // namespace multipanda
