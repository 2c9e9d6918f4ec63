#pragma once

#include <vector>

#include "core/controllets/parameters.hpp"
#include "core/model/arm_model.hpp"

// Laws declare stiffness and damping with one number per joint, in N m/rad and N m s/rad. The number of a
// prismatic joint is in N/m or N s/m, and has a default and a bound of its own: an axis that carries an arm
// moves tens of kilograms, a revolute joint a few kg m^2. Before the loop.
namespace multipanda {

inline constexpr double kMostPrismaticStiffness = 50000;  // [N/m]
inline constexpr double kMostPrismaticDamping = 5000;     // [N s/m]

// Default stiffness of a prismatic joint [N/m]: the least mass that the joint moves swings on it at 20 rad/s,
// as a Panda's first joint does on its default. 500 to 20 000 N/m, in whole hundreds.
double usual_prismatic_stiffness(const ArmModel& model, std::size_t joint);

// `spec` with the bound and unit for an arm with prismatic joints; other kinds of parameters unchanged.
// Bounds of its revolute joints: bound_revolute_joints().
ParameterSpec with_prismatic_joints(ParameterSpec spec);

// The specs of a law for one arm; unchanged without prismatic joints.
std::vector<ParameterSpec> specs_for(const std::vector<ParameterSpec>& specs, const ArmModel& model);
// Lowers the bounds of revolute joints to those of `specs` again.
void bound_revolute_joints(const std::vector<ParameterSpec>& specs, const ArmModel& model,
                           ParameterSet& parameters);

}  // namespace multipanda
