#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// The laws of multipanda; each is stated above its class.
ControlletType hold_controllet();
ControlletType gravity_compensation_controllet();
ControlletType joint_impedance_controllet();
ControlletType cartesian_impedance_controllet();
ControlletType dual_cartesian_impedance_controllet();
ControlletType coupled_dual_cartesian_impedance_controllet();
ControlletType force_controllet();
ControlletType hybrid_force_controllet();
ControlletType ufic_controllet();
ControlletType coupled_ufic_controllet();
ControlletType joint_follower_controllet();
ControlletType pose_follower_controllet();
ControlletType teleoperation_controllet();

}  // namespace multipanda
