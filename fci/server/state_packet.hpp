#pragma once

#include "backends/simulated_arm/simulated_arm.hpp"
#include "fci/wire/robot_state.hpp"
#include "models/rigid_body.hpp"

namespace multipanda::fci {

// Fixed properties of an arm: mounting and configured end effector. Programs cannot change them.
struct FixedConfig {
  Pose X_FNE;    // nominal end effector in the flange (F_T_NE); sent as_in_settings()
  RigidBody ee;  // hand and tool, in the flange: the model that programs download ends at the flange
  Vector3 gravity_B{0, 0, -9.81};  // in the base's axes; Franka sends this constant for upright arms
};

// Joints of the control interface.
inline constexpr std::size_t kWireJoints = 7;

// An arm's current state as a packet of the control interface. The arm must have kWireJoints joints.
// Does not allocate.
void fill(RobotState& state, std::uint64_t message_id, const SimulatedArm& arm, const FixedConfig& config);

// An arm whose motion has ended since it measured: modes and errors as they will be in its next state.
void show_idle(RobotState& state, const SimulatedArm& arm);

// tau_J_d of an arm in torque control: the torque that it took last, even if its motors are still at an older
// one. Arms that show it later survive a lost command only at a fraction of the torque rate.
void show_torque_taken(RobotState& state, const JointVector& tau);

// Column-major 4x4, as on the wire.
std::array<double, 16> to_wire(const Pose& X);
// An arm's settings have four decimals for the entries of a rotation (presumed from the 0.7071 in states that
// programs have printed): the hand's 45 degrees are sent as 0.7071.
Pose as_in_settings(Pose X);
Pose to_pose(const std::array<double, 16>& column_major);
// Whether the bottom row is 0 0 0 1 and the rest a rotation, each to 1e-5, and all finite.
bool is_transform(const std::array<double, 16>& column_major);

}  // namespace multipanda::fci
