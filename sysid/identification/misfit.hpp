#pragma once

#include <string>

#include "sysid/identification/predict.hpp"

// Detects a model that does not belong to the arm of a log.
namespace multipanda {

// Without friction, a published model of the right arm leaves an error of 0.34 to 0.42 N m in real torques;
// with exchanged joints, a forgotten hand, another robot or a late torque the error is 1.4 N m and more.
inline constexpr double kMisfitMean = 0.8, kMisfitJoint = 1.5;  // RMSE of `predict` [N m]

// Empty, or a warning with the error of the model and of the best variant that was tried, if that fits: two
// joints exchanged, with or without the hand, another robot, torque that is late by up to 0.3 s. Any thread;
// a warning takes 0.1 s per second of log. Throws as `predict`.
std::string misfit(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options);

}  // namespace multipanda
