#pragma once

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/energy_tank.hpp"
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
  kErrorCutoff,
  kIntegralLimit,
  kSqueezeDamping,
  kContactThreshold,
  kSqueezeDirection,
  kApproachSpeed,
  kRamp,
  kReleaseDistance,
  kObjectMass,
  kVerticalIntegral,
  kVerticalIntegralLimit,
  kValveLaw,
  kReach,
  kTankStart,
  kTankMin,
  kTankMax,
  kTankClosing,
  kForceFeedforward,
  kForceMayPull,
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
  kGamma,
  kAlphaForce,
  kAlphaImpedance,
  kForceTank,
  kImpedanceTank,
  kStored,
  kKinetic,
  kSpringPower,
  kDampingPower,
  kFeedforwardPower,
  kNullSpacePower,
  kCoriolisPower,
  kForcePower,
  kForceDampingPower,
  kSetPointPower,
  kOtherPower,
  kCreated,
  kDistance,
  kDistanceSet,
  kVerticalForce,
  kAbsoluteError,
  kRelativeError = kAbsoluteError + 6,
  kOutputCount = kRelativeError + 6
};

ControlletDescriptor descriptor();

// Parameter values of one cycle.
struct Settings {
  Settings(const ParameterSet& parameters, const ContactBounds& contact);

  ImpedanceGains absolute, relative;
  NullSpaceGains null_space;
  ForceGains force;
  GraspSettings grasp;  // without its stiffness, which depends on the direction
  TankLimits tanks;
  ValveLaw valve_law;
  double squeeze_damping, reach, object_mass, vertical_integral, vertical_integral_limit;
};

}  // namespace multipanda::coupled_ufic
