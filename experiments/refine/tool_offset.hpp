#pragma once

#include <optional>
#include <span>

#include "analysis/comparison/align.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// How far what is on the flange is from where the scene says, from runs in which it touches a surface that
// stands where the scene says. All of it is moved by d: against the simulation without d
//   along the force's direction n the believed end effector stays back by it, and goes deeper by what it
//   presses more:
//     n . (x_real - x_sim) = -n . d + compliance n . (F_real - F_sim)
//   the force acts elsewhere:
//     M_real - M_sim = d x F
// F less what the estimate shows in free air at the start of the run. Least squares over all samples at which
// both press with at least 3 N. In the flange's frame [m]. None: no such samples, or too few, or more than 2
// cm.
std::optional<Vector3> tool_offset(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                                   const SceneArm& arm, const AlignOptions& options,
                                   double compliance_m_per_n = 0);

// Compliance of what the scene's arms touch [m/N]: of its objects' `contact`; 0: none has one, or they
// differ.
double surface_compliance(const Scene& scene);

// The robot with its flange moved by d (in the flange's frame), see last_link.hpp.
RobotDescription with_tool_offset(const RobotDescription& robot, const SceneArm& arm, const Vector3& d);

}  // namespace multipanda
