#pragma once

#include <optional>
#include <string>

#include <Eigen/Core>

#include "models/robot_description.hpp"
#include "sysid/identification/filtered_log.hpp"
#include "sysid/measured/measured_log.hpp"

// The torque that a model predicts for a log's motion, compared with the measured torque.
namespace multipanda {

struct PredictOptions {
  bool hand = false;               // the robot's hand is on the flange
  std::optional<RigidBody> tool;   // known body in the flange's frame, in addition to the hand
  Vector3 gravity_B{0, 0, -9.81};  // in the base, for logs without their own (MeasuredLog) [m/s^2]
  bool motor_friction = false;     // adds the motors' friction table to the sensor's torque
};

struct Prediction {
  JointVector rmse;             // by the protocol (docs/identification.md) [N m] (n x 1)
  double rmse_mean = 0;         // over joints
  JointVector rmse_unfiltered;  // of the same samples against the torque as measured
  Eigen::VectorXd t;            // samples of the protocol [s] (N)
  Eigen::MatrixXd measured;     // filtered [N m] (N x n)
  Eigen::MatrixXd predicted;    // [N m] (N x n)
};

// Any thread. Throws LogRefused for a log that is too short or has another joint count, and
// std::invalid_argument for a hand that the robot does not have.
Prediction predict(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options = {});

// Where the log leaves the motion from which the model was identified: empty, or a warning with the joints
// and how far they leave it.
std::string outside_range(const MeasuredLog& log, const RobotDescription& robot);

// What the torque sensors should have shown at the kept rows (N x n) [N m]:
//   gain (Y theta + protocol_filter(friction)) + offset.
Eigen::MatrixXd model_torque(const FilteredLog& log, const RobotDescription& robot,
                             const PredictOptions& options);

}  // namespace multipanda
