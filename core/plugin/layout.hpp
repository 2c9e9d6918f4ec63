#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>

#include <Eigen/Core>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/modes/registry.hpp"
#include "core/types/tick.hpp"

// A number for the memory layout of all types that a user's library shares with the program. The hash of the
// headers finds changed headers; this number finds the same headers compiled differently: with vector flags
// (-mavx aligns Eigen's objects differently), another Eigen, another standard library or its debug mode.
namespace multipanda {

// FNV-1a over the numbers.
constexpr std::uint64_t fold(std::initializer_list<std::size_t> numbers) {
  std::uint64_t hash = 14695981039346656037u;
  for (const std::size_t number : numbers) {
    for (unsigned shift = 0; shift < 64; shift += 8)
      hash = (hash ^ (number >> shift & 0xFFu)) * 1099511628211u;
  }
  return hash;
}

// offsetof is defined for these types by every compiler that builds multipanda; the standard promises it for
// simpler ones only.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Winvalid-offsetof"
#define AT(member) offsetof(T, member)

inline constexpr std::uint64_t kStateLayout = [] {
  std::uint64_t hash = fold({EIGEN_MAX_STATIC_ALIGN_BYTES, EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION,
                             EIGEN_MINOR_VERSION, sizeof(Pose), sizeof(Twist), sizeof(Wrench),
                             sizeof(JointVector), alignof(JointVector), sizeof(ArmSet)});
  {
    using T = ArmState;
    hash = fold({hash,
                 sizeof(T),
                 alignof(T),
                 AT(sequence),
                 AT(t_robot),
                 AT(t_host),
                 AT(fresh),
                 AT(age_s),
                 AT(q),
                 AT(dq),
                 AT(tau_J),
                 AT(tau_J_d),
                 AT(tau_ext_hat),
                 AT(has_wrench_estimate),
                 AT(F_K_W_est),
                 AT(has_contact_truth),
                 AT(F_K_W_true),
                 AT(config_version),
                 AT(frames),
                 AT(tool),
                 AT(load),
                 AT(mode),
                 AT(errors),
                 AT(command_success_rate),
                 AT(gripper)});
  }
  {
    using T = Load;
    hash = fold({hash, sizeof(T), AT(mass), AT(p_FC), AT(inertia_C)});
  }
  {
    using T = ArmFrames;
    hash = fold({hash, sizeof(T), AT(X_FE), AT(X_EK)});
  }
  {
    using T = GripperState;
    hash = fold({hash, sizeof(T), AT(present), AT(width), AT(max_width), AT(grasped), AT(moving)});
  }
  {
    using T = Capabilities;
    hash =
        fold({hash, sizeof(T), AT(simulated), AT(lockstep), AT(compensates_gravity), AT(compensates_friction),
              AT(has_external_torque), AT(has_contact_truth), AT(has_gripper), AT(has_vacuum),
              AT(every_command_arrives), AT(own_clock), AT(torque_low_pass_hz), AT(torque_rate_max)});
  }
  return fold({hash, sizeof(ArmModel), alignof(ArmModel), sizeof(ModelTerms), alignof(ModelTerms),
               sizeof(ArmCommand), sizeof(ArmRequest), sizeof(GripperRequest), sizeof(WorldRequest),
               sizeof(RequestAnswer), sizeof(ConnectionStatistics)});
}();

inline constexpr std::uint64_t kPluginLayout = [] {
  std::uint64_t hash =
      fold({kStateLayout, sizeof(std::string), sizeof(std::vector<bool>), sizeof(std::function<void()>),
            sizeof(Registry), sizeof(ParameterSet), sizeof(Reference), alignof(Reference)});
  {
    using T = ControlletDescriptor;
    hash = fold({hash, sizeof(T), AT(type), AT(doc), AT(arms), AT(observes), AT(moving_base),
                 AT(wrench_at_hand), AT(inputs), AT(parameters), AT(outputs)});
  }
  {
    using T = ParameterSpec;
    hash = fold(
        {hash, sizeof(T), AT(name), AT(unit), AT(size), AT(initial), AT(min), AT(max), AT(doc), AT(choices)});
  }
  {
    using T = InputSpec;
    hash = fold({hash, sizeof(T), AT(name), AT(quantity), AT(arm), AT(frame), AT(doc), AT(timeout_s),
                 AT(max_speed), AT(max_angular_speed)});
  }
  {
    using T = Obstacle;
    hash = fold({hash, sizeof(T), AT(name), AT(shape), AT(X_WO)});
  }
  {
    using T = ControlletType;
    hash = fold({hash, sizeof(T), AT(descriptor), AT(create)});
  }
  {
    using T = FeatureType;
    hash = fold({hash, sizeof(T), AT(descriptor), AT(create)});
  }
  {
    using T = BackendType;
    hash = fold({hash, sizeof(T), AT(name), AT(doc), AT(create)});
  }
  {
    using T = BackendSetup;
    hash = fold({hash, sizeof(T), AT(arms), AT(paced), AT(report)});
  }
  {
    using T = BackendSetup::Arm;
    hash = fold({hash, sizeof(T), AT(name), AT(model), AT(frames), AT(tool), AT(load), AT(q_start)});
  }
  {
    using T = OwnedArm;
    hash = fold({hash, sizeof(T), AT(state), AT(terms), AT(tau), AT(carried), AT(carried_joint)});
  }
  {
    using T = ControlContext;
    hash = fold({hash, sizeof(T), AT(dt), AT(time_s), AT(arms), AT(inputs), AT(parameters), AT(outputs),
                 AT(scene_arms), AT(contact), AT(stopped), AT(observed)});
  }
  {
    using T = FeatureContext;
    hash = fold({hash, sizeof(T), AT(arms), AT(own), AT(obstacles), AT(friction_compensated)});
  }
  {
    using T = Target;
    hash = fold({hash, sizeof(T), AT(id), AT(delivery), AT(size), AT(duration_s), AT(values), AT(sine),
                 AT(period_s), AT(cycles), AT(ramp_s), AT(harmonic_count), AT(harmonics)});
  }
  {
    using T = Tick;
    hash = fold({hash, sizeof(T), AT(cycle), AT(t), AT(dt), AT(period), AT(due), AT(start)});
  }
  return hash;
}();

#undef AT
#pragma GCC diagnostic pop

}  // namespace multipanda
