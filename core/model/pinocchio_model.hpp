#pragma once

// Private to core/model: Pinocchio's headers are slow to compile.
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>

#include "core/model/arm_model.hpp"

namespace multipanda {

struct ArmModel::Pinocchio {
  // The first joint's placement includes the base's pose, so results are in the world.
  pinocchio::Model model;
  pinocchio::JointIndex last_joint = 0;
  pinocchio::SE3 X_JF;  // flange in the last joint's frame
};

// Pinocchio's inertia in joint frame J of a body whose center of mass and inertia are given in F.
pinocchio::Inertia inertia_in_joint(const pinocchio::SE3& X_JF, const Load& load);

}  // namespace multipanda
