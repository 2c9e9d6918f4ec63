#include "fci/client/arm_packet.hpp"

#include <cmath>

#include "core/state/load_ramp.hpp"

namespace multipanda::fci {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;

void copy(const std::array<double, 7>& from, JointVector& to) { to = Eigen::Map<const Vector7>(from.data()); }

Load body(double mass, const std::array<double, 3>& com, const std::array<double, 9>& inertia) {
  return {mass, Eigen::Map<const Vector3>(com.data()), Eigen::Map<const Matrix3>(inertia.data())};
}

// Bit i: level i is not zero.
template <std::size_t N>
std::uint16_t raised(const std::array<double, N>& levels) {
  unsigned bits = 0;
  for (std::size_t i = 0; i < N; ++i) bits |= (levels[i] != 0 ? 1u : 0u) << i;
  return static_cast<std::uint16_t>(bits);
}

std::uint64_t flags(const std::array<std::uint8_t, kErrorCount>& errors) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < kErrorCount; ++i) {
    if (errors[i] != 0) bits |= std::uint64_t{1} << i;
  }
  return bits;
}

void fill_report(const RobotState& packet, InterfaceReport& report) {
  report.present = true;
  copy(packet.q_d, report.q_d);
  copy(packet.dq_d, report.dq_d);
  copy(packet.theta, report.theta);
  report.X_BE_d = pose_of(packet.O_T_EE_d);
  report.X_BE_c = pose_of(packet.O_T_EE_c);
  report.elbow = packet.elbow;
  report.joint_contact = raised(packet.joint_contact);
  report.joint_collision = raised(packet.joint_collision);
  report.cartesian_contact = static_cast<std::uint8_t>(raised(packet.cartesian_contact));
  report.cartesian_collision = static_cast<std::uint8_t>(raised(packet.cartesian_collision));
  report.last_motion_errors = flags(packet.reflex_reason);
}

}  // namespace

Load without(const Load& whole, const Load& part) { return combined(whole, 1, part, -1); }
Load with(const Load& a, const Load& b) { return combined(a, 1, b, 1); }
Load end_effector_of(const RobotState& packet) { return body(packet.m_ee, packet.F_x_Cee, packet.I_ee); }
Load payload_of(const RobotState& packet) { return body(packet.m_load, packet.F_x_Cload, packet.I_load); }

void ArmPacket::fill(const RobotState& packet, bool commanded, ArmState& state) noexcept {
  state.sequence = packet.message_id;
  state.t_robot = {static_cast<std::int64_t>(packet.message_id) * 1'000'000};
  copy(packet.q, state.q);
  copy(packet.dq, state.dq);
  copy(packet.tau_J, state.tau_J);
  copy(packet.tau_J_d, state.tau_J_d);
  if (!commanded) state.tau_J_d.setZero();  // a torque motion starts at zero
  copy(packet.tau_ext_hat_filtered, state.tau_ext_hat);
  state.has_contact_truth = false;

  const Configuration now{packet.F_T_EE, packet.EE_T_K, packet.m_ee,    packet.m_load,
                          packet.I_ee,   packet.I_load, packet.F_x_Cee, packet.F_x_Cload};
  if (version_ == 0 || !(now == last_)) {
    last_ = now;
    ++version_;
    frames_ = {with_proper_rotation(pose_of(packet.F_T_EE)), with_proper_rotation(pose_of(packet.EE_T_K))};
    tool_ = without(end_effector_of(packet), hand_);
    load_ = payload_of(packet);
  }
  state.config_version = version_;
  state.frames = frames_;
  state.tool = tool_;
  state.load = load_;

  // O_F_ext_hat_K would need a shift, since its moment is about the base's origin.
  const Matrix3 R_WK = R_WB_ * pose_of(packet.O_T_EE).rotation * frames_.X_EK.rotation;
  state.has_wrench_estimate = true;
  state.F_K_W_est.force() = R_WK * Eigen::Map<const Vector3>(packet.K_F_ext_hat_K.data());
  state.F_K_W_est.torque() = R_WK * Eigen::Map<const Vector3>(packet.K_F_ext_hat_K.data() + 3);

  state.errors = flags(packet.errors);
  state.command_success_rate = packet.control_command_success_rate;
  fill_report(packet, state.report);
}

}  // namespace multipanda::fci
