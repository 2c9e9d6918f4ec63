// All controllets and features of multipanda. Add a line here for a new one.
#include "core/controllets/builtins.hpp"

#include "core/features/builtins.hpp"
#include "core/modes/registry.hpp"

namespace multipanda {

Registry Registry::with_builtins() {
  Registry registry;
  registry.add(hold_controllet());
  registry.add(gravity_compensation_controllet());
  registry.add(joint_impedance_controllet());
  registry.add(cartesian_impedance_controllet());
  registry.add(dual_cartesian_impedance_controllet());
  registry.add(coupled_dual_cartesian_impedance_controllet());
  registry.add(force_controllet());
  registry.add(hybrid_force_controllet());
  registry.add(ufic_controllet());
  registry.add(coupled_ufic_controllet());
  registry.add(joint_follower_controllet());
  registry.add(pose_follower_controllet());
  registry.add(teleoperation_controllet());
  registry.add(joint_limits_feature());
  registry.add(collision_avoidance_feature());
  registry.add(manipulability_feature());
  registry.add(friction_compensation_feature());
  return registry;
}

}  // namespace multipanda
