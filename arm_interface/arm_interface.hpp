#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "core/state/arm_state.hpp"
#include "core/types/spatial.hpp"

// The arm's control interface as data: the command and the state of one period. The comment after each
// quantity gives its name in libfranka. B is the arm's base (O in libfranka). Simulated arms use these
// structures directly; fci/ encodes and decodes them.
namespace multipanda {

// Which of the arm's own controllers turns the desired motion into torque; with `external`, the program
// computes the torque.
enum class ArmController : std::uint8_t { joint_impedance, cartesian_impedance, external, other };

// The desired motion that the program sends. `none`: torques only. `idle`: no motion runs.
enum class MotionGenerator : std::uint8_t {
  idle,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity,
  none
};

constexpr bool is_cartesian(MotionGenerator generator) {
  return generator == MotionGenerator::cartesian_pose || generator == MotionGenerator::cartesian_velocity;
}

// Result of starting a motion. The arm's state changes only if the result is `started`.
enum class MotionStart : std::uint8_t {
  started,
  not_possible,      // not in this mode: reflex, user stop, guiding, or a motion runs already
  invalid_argument,  // unknown combination, or limits that are not finite
  singular           // a Cartesian motion cannot start at a singular pose
};

// Outcome of a motion.
enum class MotionEnd : std::uint8_t {
  none,         // still running, or no motion was started
  finished,     // as commanded, at rest
  preempted,    // stopped on request
  reflex,       // stopped by an error
  user_stop,    // stopped by the stop button
  input_error,  // an invalid command
  still_moving  // finished by command while the desired motion was not at rest
};

struct MotionRequest {
  ArmController controller = ArmController::external;
  MotionGenerator generator = MotionGenerator::none;
  // The arm plans the motion to each q_c itself. Commands may be missing.
  bool asynchronous = false;
  JointVector dq_max;  // of asynchronous motion [rad/s] (n x 1)
};

// Joint 3 and the side of joint 4 fix the elbow of a seven-joint arm: {q3 [rad], +1 or -1}.
using Elbow = std::array<double, 2>;

// The command of one period. The arm reads only the fields of the running motion.
struct InterfaceCommand {
  JointVector q_c;                      // joint_position [rad] (n x 1)
  JointVector dq_c;                     // joint_velocity [rad/s] (n x 1)
  std::array<double, 16> O_T_EE_c{};    // cartesian_pose: X_BE, column-major, as sent, not checked
  Vector6 O_dP_EE_c = Vector6::Zero();  // cartesian_velocity: V_BE [m/s, rad/s]
  bool has_elbow = false;
  Elbow elbow_c{};
  JointVector tau_J_d;  // external controller: without gravity [N m] (n x 1)
  bool motion_finished = false, torque_finished = false;
};

// The error flags of the control interface, in the order of the wire: bit i of ArmState::errors.
// Texts and names: arm_interface/arm_error.hpp.

// The arm's state beyond ArmState, once per period.
struct InterfaceState {
  // Desired joint motion: the last joint command and its backward differences; the held position when idle.
  JointVector q_d, dq_d, ddq_d;  // [rad], [rad/s], [rad/s^2] (n x 1)
  JointVector theta, dtheta;     // motor side [rad], [rad/s] (n x 1)
  JointVector dtau_J;            // [N m/s] (n x 1)

  // End effector in the base: measured, desired (after inverse kinematics), last commanded
  Pose X_BE, X_BE_d, X_BE_c;         // O_T_EE, O_T_EE_d, O_T_EE_c
  Twist V_BE_d, V_BE_c;              // O_dP_EE_d, O_dP_EE_c
  Vector6 A_BE_c = Vector6::Zero();  // O_ddP_EE_c [m/s^2, rad/s^2]
  Elbow elbow{}, elbow_d{}, elbow_c{}, delbow_c{}, ddelbow_c{};

  // Forces: what the arm exerts on the environment
  JointVector tau_ext_hat;                     // tau_ext_hat_filtered [N m] (n x 1)
  Wrench F_B_B;                                // O_F_ext_hat_K: about the base's origin, axes of B
  Wrench F_K_K;                                // K_F_ext_hat_K: about K, axes of K
  JointVector joint_contact, joint_collision;  // levels: 0 or 1 per joint (n x 1); collision latched
  Vector6 cartesian_contact = Vector6::Zero(),
          cartesian_collision = Vector6::Zero();  // x y z roll pitch yaw, in K

  // Condition
  ArmController controller = ArmController::other;
  MotionGenerator generator = MotionGenerator::idle;
  ArmMode mode = ArmMode::idle;
  std::uint64_t errors = 0;         // active now; bit i: error i
  std::uint64_t reflex_reason = 0;  // of the last reflex, until the next motion begins (last_motion_errors)
  double command_success_rate = 0;  // of the last 100 periods; 0 when no motion runs
};

// O_F_ext_hat_K of the wrench about p_WK in world axes: about the base's origin, in its axes. [N, N m]
inline Wrench F_B_B_of(const Wrench& F_K_W, const Vector3& p_WK, const Pose& X_WB) {
  const Wrench F_B_W = shifted(F_K_W, p_WK - X_WB.position);
  const Matrix3 R_BW = X_WB.rotation.transpose();
  Wrench F_B_B;
  F_B_B.vector << R_BW * F_B_W.force(), R_BW * F_B_W.torque();
  return F_B_B;
}

// A backend starts to execute a request to an arm within this time, or refuses it: the caller may have given
// up by then, and nothing may move after it was told of a failure.
inline constexpr double kRequestPatience = 5;  // [s]
// Additional waiting time of the caller. By then the request has either been started, with its end unknown,
// or it waits behind another one and will be refused.
inline constexpr double kRequestSlack = 0.5;  // [s]

inline constexpr const char* kRequestTooOld =
    "the request is too old, or its sender no longer waits, and it was not executed: send it again";
inline constexpr const char* kRequestUnfinished =
    "the arm has not finished the request: it may still be executed; check the arm before you try again";

}  // namespace multipanda
