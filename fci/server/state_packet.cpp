#include "fci/server/state_packet.hpp"

#include <cmath>

namespace multipanda::fci {
namespace {

template <typename Vector, std::size_t N>
void put(std::array<double, N>& to, const Vector& from) {
  for (std::size_t i = 0; i < N; ++i) to[i] = from(static_cast<Eigen::Index>(i));
}

void put(std::array<double, 9>& to, const Matrix3& from) {
  for (std::size_t i = 0; i < 9; ++i) to[i] = from.data()[i];  // both column-major
}

void put(std::array<std::uint8_t, kErrorCount>& to, std::uint64_t flags) {
  for (std::size_t i = 0; i < kErrorCount; ++i) to[i] = static_cast<std::uint8_t>(flags >> i & 1u);
}

RobotMode wire_mode(ArmMode mode) {
  switch (mode) {
    case ArmMode::idle:
      return RobotMode::idle;
    case ArmMode::move:
      return RobotMode::move;
    case ArmMode::guiding:
      return RobotMode::guiding;
    case ArmMode::reflex:
      return RobotMode::reflex;
    case ArmMode::user_stopped:
      return RobotMode::user_stopped;
    case ArmMode::recovering:
      return RobotMode::automatic_error_recovery;
    case ArmMode::other:
    case ArmMode::disconnected:
      break;
  }
  return RobotMode::other;
}

}  // namespace

std::array<double, 16> to_wire(const Pose& X) {
  std::array<double, 16> result{};
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      result[static_cast<std::size_t>(4 * column + row)] = X.rotation(row, column);
    }
  }
  for (int row = 0; row < 3; ++row) result[static_cast<std::size_t>(12 + row)] = X.position[row];
  result[15] = 1;
  return result;
}

Pose as_in_settings(Pose X) {
  X.rotation = (X.rotation.array() * 1e4).round() * 1e-4;
  return X;
}

Pose to_pose(const std::array<double, 16>& from) {
  Pose X;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      X.rotation(row, column) = from[static_cast<std::size_t>(4 * column + row)];
    }
  }
  for (int row = 0; row < 3; ++row) X.position[row] = from[static_cast<std::size_t>(12 + row)];
  return X;
}

bool is_transform(const std::array<double, 16>& from) {
  constexpr double kSlack = 1e-5;
  for (const double value : from) {
    if (!std::isfinite(value)) return false;
  }
  if (std::abs(from[3]) > kSlack || std::abs(from[7]) > kSlack || std::abs(from[11]) > kSlack ||
      std::abs(from[15] - 1) > kSlack) {
    return false;
  }
  const Matrix3 R = to_pose(from).rotation;
  return (R * R.transpose() - Matrix3::Identity()).cwiseAbs().maxCoeff() < 3 * kSlack && R.determinant() > 0;
}

void fill(RobotState& state, std::uint64_t message_id, const SimulatedArm& arm, const FixedConfig& config) {
  const ArmState& seen = arm.state();
  const InterfaceState& own = arm.interface();
  const ArmSettings& set = arm.settings();

  state.message_id = message_id;
  state.O_T_EE = to_wire(own.X_BE);
  state.O_T_EE_d = to_wire(own.X_BE_d);
  state.O_T_EE_c = to_wire(own.X_BE_c);
  state.EE_T_K = to_wire(set.frames.X_EK);
  const Pose X_NEE = config.X_FNE.inverse() * set.frames.X_FE, X_FNE = as_in_settings(config.X_FNE);
  state.F_T_NE = to_wire(X_FNE);
  state.NE_T_EE = to_wire(X_NEE);
  state.F_T_EE = to_wire({X_FNE.rotation * X_NEE.rotation, X_FNE * X_NEE.position});
  state.m_ee = config.ee.mass;
  put(state.I_ee, config.ee.inertia);
  put(state.F_x_Cee, config.ee.com);
  state.m_load = set.load.mass;
  put(state.I_load, set.load.inertia_C);
  put(state.F_x_Cload, set.load.p_FC);

  state.elbow = own.elbow;
  state.elbow_d = own.elbow_d;
  state.elbow_c = own.elbow_c;
  state.delbow_c = own.delbow_c;
  state.ddelbow_c = own.ddelbow_c;

  put(state.tau_J, seen.tau_J);
  put(state.tau_J_d, seen.tau_J_d);
  put(state.dtau_J, own.dtau_J);
  put(state.q, seen.q);
  put(state.dq, seen.dq);
  put(state.q_d, own.q_d);
  put(state.dq_d, own.dq_d);
  put(state.ddq_d, own.ddq_d);
  put(state.theta, own.theta);
  put(state.dtheta, own.dtheta);

  put(state.joint_contact, own.joint_contact);
  put(state.joint_collision, own.joint_collision);
  put(state.cartesian_contact, own.cartesian_contact);
  put(state.cartesian_collision, own.cartesian_collision);
  put(state.tau_ext_hat_filtered, own.tau_ext_hat);
  put(state.O_F_ext_hat_K, own.F_K_B.vector);
  put(state.K_F_ext_hat_K, own.F_K_K.vector);
  put(state.O_dP_EE_d, own.V_BE_d.vector);
  put(state.O_dP_EE_c, own.V_BE_c.vector);
  put(state.O_ddP_EE_c, own.A_BE_c);
  put(state.O_ddP_O, config.gravity_B);

  state.motion_generator_mode = static_cast<std::uint8_t>(own.generator);  // the same order as the wire's
  state.controller_mode = static_cast<std::uint8_t>(own.controller);
  state.robot_mode = static_cast<std::uint8_t>(wire_mode(own.mode));
  put(state.errors, own.errors);
  put(state.reflex_reason, own.reflex_reason);
  state.control_command_success_rate = own.command_success_rate;
}

void show_idle(RobotState& state, const SimulatedArm& arm) {
  state.motion_generator_mode = static_cast<std::uint8_t>(MotionGeneratorMode::idle);
  state.controller_mode = static_cast<std::uint8_t>(ControllerMode::other);
  state.robot_mode = static_cast<std::uint8_t>(wire_mode(arm.mode()));
  put(state.errors, arm.errors());
  if (arm.errors() != 0) put(state.reflex_reason, arm.errors());
  state.control_command_success_rate = 0;
}

void show_torque_taken(RobotState& state, const JointVector& tau) { put(state.tau_J_d, tau); }

}  // namespace multipanda::fci
