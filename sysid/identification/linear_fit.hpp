#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/inertial_parameters.hpp"
#include "sysid/measured/measured_log.hpp"

// The linear stage by itself: least squares on base parameters and friction amplitudes, without prior,
// consistency or bounds, with intervals that allow for correlated residuals.
namespace multipanda {

// States and torques of one arm at evenly spaced samples, exact or filtered.
struct MotionData {
  Eigen::MatrixXd q, dq, ddq;  // [rad, rad/s, rad/s^2] (N x n)
  Eigen::MatrixXd tau;         // [N m] (N x n)
  // One (N x n) for each requested friction part, in the order of LinearOptions::friction. Empty: none.
  std::vector<Eigen::MatrixXd> friction;
  std::optional<Vector3> gravity_B;  // in its base [m/s^2]; none: LinearOptions::gravity_B
};

struct LinearOptions {
  // In addition to the rigid body; {} for simulated arms, whose tau has no such friction.
  std::vector<FrictionPart> friction;
  bool hand = false;               // the robot's hand is on the flange
  std::optional<RigidBody> tool;   // known body in the flange's frame, in addition to the hand
  Vector3 gravity_B{0, 0, -9.81};  // in the base, for data without their own [m/s^2]
  bool body_only = false;          // the links are known: only ten parameters of a body on the last link
  int passes = 3;                  // of weighting the joints by the spread of their residuals
};

struct LinearFit {
  BaseParameters base;             // the r identifiable combinations
  std::vector<std::string> names;  // of every value
  std::vector<std::string> units;  // of every value: "kg m^2"
  Eigen::VectorXd value;           // r base parameters, then for joint 1, 2, ... its friction amplitudes
  Eigen::MatrixXd covariance;      // of `value`
  Eigen::VectorXd half95;          // the true value lies within value +- half95 with 95 %
  Condition condition;             // of the base parameters' regressor on these data
  JointVector rmse;                // [N m] (n x 1)
  Eigen::Index longest_lag = 0;    // samples over which residuals are significantly correlated
};

// Takes base tilt and sensor gains of `robot` as known, and theta for the effect of tilt; not its friction.
// All data have the same sample period.
LinearFit fit_linear(std::span<const MotionData> data, const RobotDescription& robot,
                     const LinearOptions& options = {});

// The same after the protocol's filters. Throws LogRefused if a log is too short.
LinearFit fit_linear(std::span<const MeasuredLog> logs, const RobotDescription& robot,
                     const LinearOptions& options = {});

}  // namespace multipanda
