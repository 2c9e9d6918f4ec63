#pragma once

#include <array>
#include <cstdint>

// The arm's state as the control interface carries it, once per millisecond, with Franka's names. All numbers
// are doubles here, whatever the protocol version sends. Matrices are column-major 4x4, I_* column-major 3x3;
// O is the arm's base; SI units; signs as in CONVENTIONS.md ("Vendor map"). The layout of each version is in
// fci/wire/state_layout.hpp.
namespace multipanda::fci {

inline constexpr std::size_t kErrorCount = 41;

struct RobotState {
  std::uint64_t message_id = 0;  // counts milliseconds since the arm's start
  std::array<double, 16> O_T_EE{}, O_T_EE_d{}, F_T_EE{}, EE_T_K{}, F_T_NE{}, NE_T_EE{};
  double m_ee = 0;
  std::array<double, 9> I_ee{};
  std::array<double, 3> F_x_Cee{};
  double m_load = 0;
  std::array<double, 9> I_load{};
  std::array<double, 3> F_x_Cload{};
  std::array<double, 2> elbow{}, elbow_d{};
  std::array<double, 7> tau_J{}, tau_J_d{}, dtau_J{}, q{}, q_d{}, dq{}, dq_d{}, ddq_d{};
  std::array<double, 7> joint_contact{};
  std::array<double, 6> cartesian_contact{};
  std::array<double, 7> joint_collision{};
  std::array<double, 6> cartesian_collision{};
  std::array<double, 7> tau_ext_hat_filtered{};
  std::array<double, 6> O_F_ext_hat_K{}, K_F_ext_hat_K{}, O_dP_EE_d{};
  std::array<double, 3> O_ddP_O{};
  std::array<double, 2> elbow_c{}, delbow_c{}, ddelbow_c{};
  std::array<double, 16> O_T_EE_c{};
  std::array<double, 6> O_dP_EE_c{}, O_ddP_EE_c{};
  std::array<double, 7> theta{}, dtheta{};
  std::array<double, 18> accelerometer_top{}, accelerometer_bottom{};  // [6][3]
  std::uint8_t motion_generator_mode = 0, controller_mode = 3;         // MotionGeneratorMode, ControllerMode
  std::array<std::uint8_t, kErrorCount> errors{}, reflex_reason{};
  std::uint8_t robot_mode = 0;  // RobotMode
  double control_command_success_rate = 0;
};

// One period's command.
struct RobotCommand {
  std::uint64_t message_id = 0;  // of the state it answers
  std::array<double, 7> q_c{}, dq_c{};
  std::array<double, 16> O_T_EE_c{};
  std::array<double, 6> O_dP_EE_c{};
  std::array<double, 2> elbow_c{};
  bool valid_elbow = false, motion_generation_finished = false;
  std::array<double, 7> tau_J_d{};
  bool torque_command_finished = false;
};

// Values of RobotState's modes on the wire.
enum class MotionGeneratorMode : std::uint8_t {
  idle,
  joint_position,
  joint_velocity,
  cartesian_position,
  cartesian_velocity,
  none
};
enum class ControllerMode : std::uint8_t { joint_impedance, cartesian_impedance, external, other };
enum class RobotMode : std::uint8_t {
  other,
  idle,
  move,
  guiding,
  reflex,
  user_stopped,
  automatic_error_recovery
};

}  // namespace multipanda::fci
