#pragma once

// Private to core/model: the only header that names Pinocchio. Including it costs half a minute of compiling.
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>

#include "core/model/arm_model.hpp"

namespace multipanda {

struct ArmModel::Pinocchio {
  pinocchio::Model model;  // the base's pose is in the first joint's placement: results are in the world
  pinocchio::FrameIndex flange = 0;
  pinocchio::JointIndex last_joint = 0;
  pinocchio::SE3 X_JF;  // flange in the last joint's frame
};

// Body of mass m, centre of mass and inertia given in F, as Pinocchio writes it in frame J.
pinocchio::Inertia inertia_in_joint(const pinocchio::SE3& X_JF, const Load& load);

}  // namespace multipanda
