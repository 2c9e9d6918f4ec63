#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "core/state/arm_state.hpp"

// The arm's control interface as data: what a controlling program may send in one period, and all that the
// arm tells in one period. The names of the maker's library stand behind each quantity. B is the arm's base
// (the maker's O). No wire here: fci/ carries these to and from bytes, and a simulated arm is driven by them
// directly.
namespace multipanda {

// Which of the arm's own controllers turns the desired motion into torque; `external`: the program does.
enum class ArmController : std::uint8_t { joint_impedance, cartesian_impedance, external, other };

// What the program sends as desired motion. `none`: torques only. `idle`: nothing runs.
enum class MotionGenerator : std::uint8_t {
  idle,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity,
  none
};

// How the start of a motion was answered. The arm's state changes only when it is `started`.
enum class MotionStart : std::uint8_t {
  started,
  not_possible,      // not in this mode: reflex, user stop, guiding, or a motion runs already
  invalid_argument,  // a combination that does not exist, limits that are no numbers
  singular           // Cartesian motion from a singular pose
};

// How a motion ended.
enum class MotionEnd : std::uint8_t {
  none,         // it still runs, or there was none
  finished,     // as commanded, at rest
  preempted,    // stopped on request
  reflex,       // an error stopped it
  user_stop,    // the button did
  input_error,  // a command that is no command
  still_moving  // commanded to be finished, but the desired motion was not at rest
};

struct MotionRequest {
  ArmController controller = ArmController::external;
  MotionGenerator generator = MotionGenerator::none;
  // The arm plans the motion to each q_c itself, and commands may be missing.
  bool asynchronous = false;
  JointVector dq_max;  // of asynchronous motion [rad/s] (n x 1)
};

// Joint 3 and the side of joint 4 fix the elbow of a seven-joint arm: {q3 [rad], +1 or -1}.
using Elbow = std::array<double, 2>;

// One period's command. Only what the running motion asks for is read.
struct InterfaceCommand {
  JointVector q_c;                      // joint_position [rad] (n x 1)
  JointVector dq_c;                     // joint_velocity [rad/s] (n x 1)
  std::array<double, 16> O_T_EE_c{};    // cartesian_pose: X_BE, column-major, as sent: it may be no transform
  Vector6 O_dP_EE_c = Vector6::Zero();  // cartesian_velocity: V_BE [m/s, rad/s]
  bool has_elbow = false;
  Elbow elbow_c{};
  JointVector tau_J_d;  // external controller: without gravity [N m] (n x 1)
  bool motion_finished = false, torque_finished = false;
};

// The error flags of the control interface, in the order of the wire: bit i of ArmState::errors.
// Texts and names: backends/arm/arm_error.hpp.

// All that the arm tells beyond ArmState, once per period.
struct InterfaceState {
  // Desired joint motion: the last joint command and its backward differences; the held place when idle.
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
  Wrench F_K_B;                                // O_F_ext_hat_K: about K, axes of B
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

}  // namespace multipanda
