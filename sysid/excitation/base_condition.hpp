#pragma once

#include "sysid/excitation/dynamics_regressor.hpp"

namespace multipanda {

// How well motions distinguish the base parameters of a robot: the condition number of the
// regressor's independent columns, each scaled to unit length over the motion. 1 would be perfect.
// One instance per thread.
class BaseCondition {
 public:
  // Finds the independent columns at random states (fixed seed): as many as the chain has base parameters.
  explicit BaseCondition(const RobotDescription& robot);

  std::size_t parameters() const { return columns_.size(); }
  const std::vector<Eigen::Index>& columns() const { return columns_; }  // of the whole regressor
  void begin();                                                          // forgets the samples
  void add(const JointVector& q, const JointVector& dq, const JointVector& ddq);
  double value() const;  // of the samples so far; infinite if a column is zero in all of them

 private:
  DynamicsRegressor regressor_;
  std::vector<Eigen::Index> columns_;
  Eigen::MatrixXd chosen_, gram_;
};

}  // namespace multipanda
