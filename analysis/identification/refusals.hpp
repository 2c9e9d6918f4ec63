#pragma once

#include <span>
#include <string>
#include <vector>

#include "analysis/identification/base_parameters.hpp"
#include "analysis/identification/equations.hpp"

// When data do not carry an identification, each with the number that shows it.
namespace multipanda {

// Throws LogRefused: another joint count, positions outside the range of `robot`.
void refuse_other_robot(std::span<const MeasuredLog> logs, const RobotDescription& robot);

// Throws LogRefused if the robot as it is leaves most of the measured torque unexplained: another robot,
// other units, joints in another order. `theta` with hand and tool (10 n).
void refuse_unexplained(const Equations& equations, const Eigen::VectorXd& theta,
                        const RobotDescription& robot);

// Condition of the regressor's `leading` columns in these equations.
Condition condition_of(const Equations& equations, const std::vector<Eigen::Index>& leading);

// Throws LogRefused if the columns cannot be told apart; adds to `warnings` where hardly.
void refuse_unexciting(const Condition& condition, std::vector<std::string>& warnings);

}  // namespace multipanda
