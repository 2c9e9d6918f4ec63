#pragma once

#include <optional>
#include <string>
#include <vector>

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

// Detects a model that does not belong to the arm of a log.

// Without friction, a published model of the right arm leaves an error of 0.34 to 0.42 N m in real torques;
// with exchanged joints, a forgotten hand, another robot or a late torque the error is 1.4 N m and more.
inline constexpr double kMisfitMean = 0.8, kMisfitJoint = 1.5;  // RMSE of `predict` [N m]

// Empty, or a warning with the error of the model and of the best variant that was tried, if that fits: two
// joints exchanged, with or without the hand, another robot, torque that is late by up to 0.3 s. Any thread;
// a warning takes 0.1 s per second of log. Throws as `predict`.
std::string misfit(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options);

// External torque of a recorded arm by the loop's observer, and when something touched the arm.

// tau_ext_hat of ExternalForceObserver along the log (N x n) [N m]. Throws as `predict`.
Eigen::MatrixXd observed_torque(const MeasuredLog& log, const RobotDescription& robot,
                                const PredictOptions& options);

// A touch is a quick change: any joint's external torque, low-passed at `stage_hz`, differs by more than
// `threshold` from the same low-passed at `tare_hz`, which follows errors of the model and friction. On 90 Hz
// data of an arm that holds its pose, 7, 3 Hz and 0.5 N m are in the middle between the smallest of 45
// touches (1.0) and the largest signal without one (0.34). Moving arms show friction.
struct TouchOptions {
  double stage_hz = 7, tare_hz = 3;  // first order; a stage of 0: none
  double threshold = 0.5;            // [N m]
};

// Compared with `contact` of the log: a touch may be found 50 ms before its label, which a person's glove
// gave, and its release up to 300 ms after it.
struct JudgedTouches {
  std::size_t touches = 0, missed = 0, false_alarms = 0;
  std::vector<double> delays;  // of those found, after the label [s]
  double quiet = 0;  // largest signal without a touch, the least threshold without false alarms [N m]
};

struct Touches {
  std::vector<double> starts;           // [s]
  std::optional<JudgedTouches> judged;  // none: the log has no labels
};

// `tau_ext` (N x n): at the log's samples.
Touches find_touches(const MeasuredLog& log, const Eigen::MatrixXd& tau_ext, const TouchOptions& options);

}  // namespace multipanda
