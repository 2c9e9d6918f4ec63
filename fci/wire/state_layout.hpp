#pragma once

#include <span>

#include "fci/wire/archive.hpp"
#include "fci/wire/commands.hpp"
#include "fci/wire/robot_state.hpp"

// The two datagrams of the 1 kHz exchange: the arm's state, and the command that answers it.
namespace multipanda::fci {

template <class Archive, class State>
constexpr void carry_state(Archive& a, State& s, const Dialect& d) {
  a.integer("message_id", s.message_id);
  a.numbers("O_T_EE", s.O_T_EE);
  a.numbers("O_T_EE_d", s.O_T_EE_d);
  a.numbers("F_T_EE", s.F_T_EE);
  a.numbers("EE_T_K", s.EE_T_K);
  a.numbers("F_T_NE", s.F_T_NE);
  a.numbers("NE_T_EE", s.NE_T_EE);
  a.number("m_ee", s.m_ee);
  a.numbers("I_ee", s.I_ee);
  a.numbers("F_x_Cee", s.F_x_Cee);
  a.number("m_load", s.m_load);
  a.numbers("I_load", s.I_load);
  a.numbers("F_x_Cload", s.F_x_Cload);
  a.numbers("elbow", s.elbow);
  a.numbers("elbow_d", s.elbow_d);
  a.numbers("tau_J", s.tau_J);
  a.numbers("tau_J_d", s.tau_J_d);
  a.numbers("dtau_J", s.dtau_J);
  a.numbers("q", s.q);
  a.numbers("q_d", s.q_d);
  a.numbers("dq", s.dq);
  a.numbers("dq_d", s.dq_d);
  a.numbers("ddq_d", s.ddq_d);
  a.numbers("joint_contact", s.joint_contact);
  a.numbers("cartesian_contact", s.cartesian_contact);
  a.numbers("joint_collision", s.joint_collision);
  a.numbers("cartesian_collision", s.cartesian_collision);
  a.numbers("tau_ext_hat_filtered", s.tau_ext_hat_filtered);
  a.numbers("O_F_ext_hat_K", s.O_F_ext_hat_K);
  a.numbers("K_F_ext_hat_K", s.K_F_ext_hat_K);
  a.numbers("O_dP_EE_d", s.O_dP_EE_d);
  if (d.has_base_acceleration()) a.numbers("O_ddP_O", s.O_ddP_O);
  a.numbers("elbow_c", s.elbow_c);
  a.numbers("delbow_c", s.delbow_c);
  a.numbers("ddelbow_c", s.ddelbow_c);
  a.numbers("O_T_EE_c", s.O_T_EE_c);
  a.numbers("O_dP_EE_c", s.O_dP_EE_c);
  a.numbers("O_ddP_EE_c", s.O_ddP_EE_c);
  a.numbers("theta", s.theta);
  a.numbers("dtheta", s.dtheta);
  if (d.has_accelerometers()) {
    a.numbers("accelerometer_top", s.accelerometer_top);
    a.numbers("accelerometer_bottom", s.accelerometer_bottom);
  }
  a.integer("motion_generator_mode", s.motion_generator_mode);
  a.integer("controller_mode", s.controller_mode);
  a.flags("errors", s.errors, d.error_count());
  a.flags("reflex_reason", s.reflex_reason, d.error_count());
  a.integer("robot_mode", s.robot_mode);
  a.number("control_command_success_rate", s.control_command_success_rate);
}

// Commands are doubles in every version.
template <class Archive, class Command>
constexpr void carry_command(Archive& a, Command& c, const Dialect& d) {
  a.integer("message_id", c.message_id);
  a.numbers("q_c", c.q_c);
  a.numbers("dq_c", c.dq_c);
  a.numbers("O_T_EE_c", c.O_T_EE_c);
  a.numbers("O_dP_EE_c", c.O_dP_EE_c);
  a.numbers("elbow_c", c.elbow_c);
  a.flag("valid_elbow", c.valid_elbow);
  a.flag("motion_generation_finished", c.motion_generation_finished);
  a.numbers("tau_J_d", c.tau_J_d);
  if (d.has_none_generator()) a.flag("torque_command_finished", c.torque_command_finished);
}

// Offset of a field [bytes from the start of the datagram]; Measure::kNowhere if the version lacks it.
constexpr std::size_t state_offset(const Dialect& d, std::string_view field) {
  Measure a(field, d.is_single_precision());
  const RobotState s{};
  carry_state(a, s, d);
  return a.found();
}
constexpr std::size_t command_offset(const Dialect& d, std::string_view field) {
  Measure a(field);
  const RobotCommand c{};
  carry_command(a, c, d);
  return a.found();
}

// [bytes]
constexpr std::size_t state_size(const Dialect& d) {
  Measure a({}, d.is_single_precision());
  const RobotState s{};
  carry_state(a, s, d);
  return a.size();
}
constexpr std::size_t command_size(const Dialect& d) {
  Measure a;
  const RobotCommand c{};
  carry_command(a, c, d);
  return a.size();
}

// Room for one datagram of any version.
inline constexpr std::size_t kMaxStateSize = state_size(kDialects[1]);
inline constexpr std::size_t kMaxCommandSize = command_size(kDialects.back());

// As in libfranka. A change in one version shifts all later fields, so a few offsets are enough.
static_assert(state_size(*dialect(4)) == 2341 && state_size(*dialect(5)) == 2373);
static_assert(state_size(*dialect(6)) == 2373 && state_size(*dialect(7)) == 2373);
static_assert(state_size(*dialect(8)) == 2373 && state_size(*dialect(9)) == 2373);
static_assert(state_size(*dialect(10)) == 1377 && kMaxStateSize == 2373);
static_assert(command_size(*dialect(4)) == 370 && command_size(*dialect(6)) == 370);
static_assert(command_size(*dialect(7)) == 371 && command_size(*dialect(10)) == 371 &&
              kMaxCommandSize == 371);
static_assert(state_offset(*dialect(10), "q") == 596 && state_offset(*dialect(5), "q") == 1184);
static_assert(state_offset(*dialect(10), "O_T_EE_c") == 976 && state_offset(*dialect(5), "O_T_EE_c") == 1944);
static_assert(state_offset(*dialect(4), "O_T_EE_c") == 1920);
static_assert(state_offset(*dialect(10), "motion_generator_mode") == 1288);
static_assert(state_offset(*dialect(5), "motion_generator_mode") == 2280);
static_assert(state_offset(*dialect(10), "robot_mode") == 1372 &&
              state_offset(*dialect(5), "robot_mode") == 2364);
static_assert(command_offset(*dialect(10), "tau_J_d") == 314);

// Encoding needs room for the whole message and returns its size, or 0 if `to` is too small.
std::size_t encode(const Dialect& d, const RobotState& state, std::span<std::byte> to);
std::size_t encode(const Dialect& d, const RobotCommand& command, std::span<std::byte> to);

// Fields that the version lacks keep their values in `state`. A datagram may be longer than the state, as
// libfranka allows; modes outside their enumeration are invalid. After an error `state` is partly filled.
[[nodiscard]] WireResult decode(const Dialect& d, std::span<const std::byte> from, RobotState& state);

// A command must have exactly its size. Numbers are not checked: the arm refuses those that are not finite.
// After an error `command` is partly filled.
[[nodiscard]] WireResult decode(const Dialect& d, std::span<const std::byte> from, RobotCommand& command);

}  // namespace multipanda::fci
