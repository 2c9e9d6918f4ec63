#pragma once

#include <string>

#include "sysid/identification/predict.hpp"

// A model that cannot be of the arm that a log was measured on.
namespace multipanda {

// A published model of the right arm leaves 0.34 to 0.42 N m of real torques, without friction; with joints
// exchanged, the hand forgotten, another robot or a late torque 1.4 N m and more.
inline constexpr double kMisfitMean = 0.8, kMisfitJoint = 1.5;  // RMSE of `predict` [N m]

// Empty, or a warning: what the model leaves, and what leaves least of all that was tried, if that fits: two
// joints exchanged, with or without the hand, another robot, torque that is late by up to 0.3 s. Any thread;
// 0.1 s per second of log if there is something to say. Throws as `predict`.
std::string misfit(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options);

}  // namespace multipanda
