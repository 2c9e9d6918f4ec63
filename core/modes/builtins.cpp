// All controllets and features of multipanda. Add a line here for a new one.
#include "core/controllets/cartesian_impedance.hpp"
#include "core/controllets/coupled_dual_cartesian_impedance.hpp"
#include "core/controllets/coupled_ufic.hpp"
#include "core/controllets/dual_cartesian_impedance.hpp"
#include "core/controllets/force.hpp"
#include "core/controllets/gravity_compensation.hpp"
#include "core/controllets/hold.hpp"
#include "core/controllets/hybrid_force.hpp"
#include "core/controllets/joint_follower.hpp"
#include "core/controllets/joint_impedance.hpp"
#include "core/controllets/pose_follower.hpp"
#include "core/controllets/teleoperation.hpp"
#include "core/controllets/ufic.hpp"
#include "core/features/collision_avoidance.hpp"
#include "core/features/friction_compensation.hpp"
#include "core/features/joint_limits.hpp"
#include "core/features/manipulability.hpp"
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
