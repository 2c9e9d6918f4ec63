#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

// The versions of the control interface's protocol, and what each changed on the wire. The version is
// negotiated once per connection (ConnectRequest), and everything after it is read and written by that
// version's Dialect. docs/fci.md has the table of versions against library and robot releases.
namespace multipanda::fci {

// libfranka has fixed ports, so arms on one host need different addresses.
inline constexpr std::uint16_t kArmPort = 1337, kGripperPort = 1338, kVacuumPort = 1339;

inline constexpr std::uint16_t kOldestVersion = 4, kNewestVersion = 10;
inline constexpr std::uint16_t kGripperVersion = 3, kVacuumVersion = 1;

struct Dialect {
  std::uint16_t version = 0;

  constexpr bool has_base_acceleration() const { return version >= 5; }         // O_ddP_O in the state
  constexpr std::size_t error_count() const { return version >= 5 ? 41 : 37; }  // flags in the state
  constexpr bool has_safety_statuses() const { return version >= 6; }           // "... by a safety function"
  constexpr bool has_none_generator() const { return version >= 7; }  // mode `none`, torque_command_finished
  constexpr bool has_model_text() const { return version >= 8; }      // GetRobotModel: URDF
  constexpr bool is_single_precision() const { return version >= 10; }      // of the state
  constexpr bool has_accelerometers() const { return version >= 10; }       // in the state
  constexpr bool has_asynchronous_motion() const { return version >= 10; }  // tail of the Move request

  // The motion generator of a program that sends torques only. Up to version 9 Franka's
  // library requests joint velocities, all zero, and ends with motion_generation_finished.
  constexpr bool torque_only_needs_generator() const { return version <= 9; }
};

inline constexpr std::array<Dialect, kNewestVersion - kOldestVersion + 1> kDialects{
    {{4}, {5}, {6}, {7}, {8}, {9}, {10}}};

// Null: a version that is not supported.
constexpr const Dialect* dialect(std::uint16_t version) {
  if (version < kOldestVersion || version > kNewestVersion) return nullptr;
  return &kDialects[static_cast<std::size_t>(version - kOldestVersion)];
}

}  // namespace multipanda::fci
