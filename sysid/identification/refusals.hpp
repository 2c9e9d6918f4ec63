#pragma once

#include <span>
#include <string>
#include <vector>

#include "sysid/identification/base_parameters.hpp"
#include "sysid/identification/equations.hpp"

// Refusals of data that do not support an identification, each with the number that shows it.
namespace multipanda {

// Throws LogRefused for another joint count and for positions outside the range of `robot`.
void refuse_other_robot(std::span<const MeasuredLog> logs, const RobotDescription& robot);

// Throws LogRefused if the given robot leaves most of the torque of a log unexplained: it is another one, or
// on another base, the units differ, or the joints are in another order. `theta` (10 n) has hand and tool.
void refuse_unexplained(const std::string& source, const Equations& equations, const Eigen::VectorXd& theta,
                        const RobotDescription& robot);

// Condition of the regressor's `leading` columns in these equations.
Condition condition_of(const Equations& equations, const std::vector<Eigen::Index>& leading);

// Throws LogRefused if the columns cannot be distinguished; adds to `warnings` if they hardly can.
void refuse_unexciting(const Condition& condition, std::vector<std::string>& warnings);

}  // namespace multipanda
