#pragma once

#include <optional>

#include "arm_interface/arm_interface.hpp"
#include "backends/simulated_arm/simulated_arm.hpp"
#include "core/cycle/backend.hpp"
#include "fci/wire/commands.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/robot_state.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

// Versions of the protocol that an arm accepts; all by default.
struct VersionRange {
  std::uint16_t oldest = kOldestVersion, newest = kNewestVersion;
};

// Fixed properties of an arm: mounting, configured end effector, system. Programs cannot change them.
struct FixedConfig {
  Pose X_FNE;    // nominal end effector in the flange (F_T_NE); sent as_in_settings()
  RigidBody ee;  // hand and tool, in the flange: the model that programs download ends at the flange
  Vector3 gravity_B{0, 0, -9.81};  // in the base's axes; Franka sends this constant for upright arms
  VersionRange versions;
};

// Joints of the control interface.
inline constexpr std::size_t kWireJoints = 7;

// An arm's current state as a packet of the control interface. The arm must have kWireJoints joints.
// Does not allocate.
void fill(RobotState& state, std::uint64_t message_id, const SimulatedArm& arm, const FixedConfig& config);

// State of an arm whose motion has ended since its measurement: modes and errors as in its next state.
void show_idle(RobotState& state, const SimulatedArm& arm);

// tau_J_d of an arm in torque control: the torque that it accepted last, even if its motors still apply an
// older one. With a later update arms would tolerate a lost command only at a fraction of the torque rate.
void show_torque_taken(RobotState& state, const JointVector& tau);

// An arm's settings have four decimals for the entries of a rotation (inferred from the 0.7071 in published
// states): the hand's 45 degrees are sent as 0.7071.
Pose as_in_settings(Pose X);
// Whether the bottom row is 0 0 0 1 and the rest a rotation, each to 1e-5, and all finite.
bool is_transform(const std::array<double, 16>& column_major);

// The declarations of a scene's arm: its mounting, hand and tool as in a real arm's settings, and the version
// of its `fci` or those of its generation. Throws std::invalid_argument.
FixedConfig fixed_config(const SceneArm& arm);

// Requests of the wire as requests to the arm. None: an argument is not finite or outside of Franka's
// documented range.

std::optional<ArmRequest> arm_request(const SetCollisionBehaviorRequest& request);
std::optional<ArmRequest> arm_request(const SetJointImpedanceRequest& request);
std::optional<ArmRequest> arm_request(const SetCartesianImpedanceRequest& request);
std::optional<ArmRequest> arm_request(const SetGuidingModeRequest& request);
std::optional<ArmRequest> arm_request(const SetEEToKRequest& request);
// X_FNE: the arm's nominal end effector in the flange.
std::optional<ArmRequest> arm_request(const SetNEToEERequest& request, const Pose& X_FNE);
std::optional<ArmRequest> arm_request(const SetLoadRequest& request);

// The motion that a Move requests.
MotionRequest motion_request(const MoveRequest& request);

void fill(InterfaceCommand& command, const RobotCommand& from);

Status status_of(MotionStart start);
Status status_of(MotionEnd end);

}  // namespace multipanda::fci
