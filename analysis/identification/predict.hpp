#pragma once

#include <optional>

#include <Eigen/Core>

#include "analysis/measured/measured_log.hpp"
#include "models/robot_description.hpp"

// What a model says of the torque that a log's sensors should have shown, given the log's motion.
namespace multipanda {

struct PredictOptions {
  bool hand = false;               // the robot's hand is on the flange
  std::optional<RigidBody> tool;   // known body in the flange's frame, beside the hand
  Vector3 gravity_B{0, 0, -9.81};  // in the base as it is believed to stand [m/s^2]
  bool motor_friction = false;     // the motors' friction table counts as if the sensor showed it
};

struct Prediction {
  JointVector rmse;             // by the protocol (docs/identification.md) [N m] (n x 1)
  double rmse_mean = 0;         // over joints
  JointVector rmse_unfiltered;  // of the same samples against the torque as measured
  Eigen::VectorXd t;            // samples of the protocol [s] (N)
  Eigen::MatrixXd measured;     // filtered [N m] (N x n)
  Eigen::MatrixXd predicted;    // [N m] (N x n)
};

// Any thread. Throws LogRefused (too short, another joint count); std::invalid_argument: no such hand.
Prediction predict(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options = {});

}  // namespace multipanda
