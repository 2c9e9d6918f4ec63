#pragma once

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/energy_balance.hpp"
#include "core/controllets/force_law.hpp"
#include "core/controllets/grasp_sequence.hpp"

// Inputs, parameters and outputs of coupled_ufic, by index, and its settings.
namespace multipanda::coupled_ufic {

enum Input : std::size_t { kPose, kSqueeze, kInputCount };

enum Parameter : std::size_t {
  kRelativeTranslational = kCartesianParameterCount,
  kRelativeRotational,
  kProportional,
  kDerivative,
  kIntegral,
  kSqueezeCutoff,
  kSqueezeLimit,
  kSqueezeDamping,
  kSqueezeThreshold,
  kSqueezeDirection,
  kApproachSpeed,
  kRamp,
  kReleaseDistance,
  kObjectMass,
  kVerticalIntegral,
  kVerticalIntegralLimit,
  kTanks,
  kFeedforward = kTanks + kTankParameterCount,
  kMayPull,
  kSqueezeMotionShare,
  kRelativeTranslationalDamping,
  kRelativeRotationalDamping,
  kParameterCount
};

enum Output : std::size_t {
  kDesired,
  kEstimated,
  kFirstEstimated,
  kSecondEstimated,
  kCommand,
  kInContact,
  kPhase,
  kTankOutputs,
  kDistance = kTankOutputs + kTankOutputCount,
  kDistanceSet,
  kVerticalForce,
  kAbsoluteError,
  kRelativeError = kAbsoluteError + 6,
  kStiffnessShare = kRelativeError + 6,
  kTare,
  kOutputCount = kTare + 2
};

ControlletDescriptor descriptor();

// Parameter values of one cycle.
struct Settings {
  Settings(const ParameterSet& parameters, const ContactBounds& contact);

  ImpedanceGains absolute, relative;
  NullSpaceGains null_space;
  ForceGains force;
  GraspSettings grasp;  // without its stiffness, which depends on the direction
  TankSettings tanks;
  double squeeze_damping, object_mass, vertical_integral, vertical_integral_limit, motion_share;
};

}  // namespace multipanda::coupled_ufic
