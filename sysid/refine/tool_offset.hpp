#pragma once

#include <optional>
#include <span>

#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "sysid/comparison/align.hpp"

namespace multipanda {

// Offset of the tool from its place in the scene, from runs in which it touches a surface whose place is
// known. The whole tool is moved by d. Compared with the simulation without d, along the force's direction n
// the assumed end effector is behind by d and goes deeper by the additional force:
//   n . (x_real - x_sim) = -n . d + compliance n . (F_real - F_sim)
// and the force acts elsewhere:
//   M_real - M_sim = d x F
// F is reduced by the estimate in free air at the start of the run. Least squares over all samples at which
// both press with at least 3 N, in the flange's frame [m]. None: too few such samples, or an offset of more
// than 2 cm.
std::optional<Vector3> tool_offset(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                                   const SceneArm& arm, const AlignOptions& options,
                                   double compliance_m_per_n = 0);

// Compliance of the objects that the scene's arms touch [m/N], from their `contact`; 0: none has one,
// or they differ.
double surface_compliance(const Scene& scene);

// The robot with its flange moved by d (in the flange's frame), see last_link.hpp.
RobotDescription with_tool_offset(const RobotDescription& robot, const SceneArm& arm, const Vector3& d);

}  // namespace multipanda
