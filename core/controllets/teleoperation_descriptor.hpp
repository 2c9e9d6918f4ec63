#pragma once

#include "core/controllets/following.hpp"

// Parameters and outputs of the controllet `teleoperation`.
namespace multipanda::teleoperation {

enum Parameter : std::size_t {
  kArchitecture = kCartesianParameterCount,
  kClutch,
  kAxes,
  kScale,
  kForceScale,
  kCutoff,
  kLeaderDamping,
  kLeaderJointDamping,
  kTankStart,
  kTankMax,
  kTankClosing,
  kRefillBelow,
  kRefillDamping,
  kDelay,
  kLoss,
  kParameterCount
};
enum class Architecture : std::uint8_t {
  position_position,  // a spring between both hands acts on both
  position_force      // the leader feels the force that the follower's estimate shows
};
enum Output : std::size_t {
  kEngaged,
  kLeaderTank,
  kFollowerTank,
  kUnderWay,
  kStored,
  kLost,
  kLeaderValve,
  kFollowerValve,
  kAge,
  kLeaderForce,
  kFollowerForce = kLeaderForce + 6,
  kError = kFollowerForce + 6,
  kSlipped = kError + 6,
  kStiffnessShare,
  kOutputCount
};

ControlletDescriptor descriptor();

}  // namespace multipanda::teleoperation
