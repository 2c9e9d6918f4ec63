#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "fci/wire/archive.hpp"

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

// Requests of the arm's TCP connection, and their number in each version. A message
// is a header and a payload; the reply repeats the header's command and command_id.

enum class Command : std::uint8_t {
  connect,
  move,
  stop_move,
  get_cartesian_limit,
  set_collision_behavior,
  set_joint_impedance,
  set_cartesian_impedance,
  set_guiding_mode,
  set_ee_to_k,
  set_ne_to_ee,
  set_load,
  set_filters,
  automatic_error_recovery,
  load_model_library,
  get_robot_model,
};
inline constexpr std::size_t kCommandCount = 15;

struct CommandInfo {
  Command command;
  std::string_view name;                    // Franka's name
  std::int8_t id_v4, id_v6, id_v8, id_v10;  // from that version on; -1: unknown
};

inline constexpr std::array<CommandInfo, kCommandCount> kCommands{{
    {Command::connect, "Connect", 0, 0, 0, 0},
    {Command::move, "Move", 1, 1, 1, 1},
    {Command::stop_move, "StopMove", 2, 2, 2, 2},
    {Command::get_cartesian_limit, "GetCartesianLimit", 3, -1, -1, -1},
    {Command::set_collision_behavior, "SetCollisionBehavior", 4, 3, 3, 3},
    {Command::set_joint_impedance, "SetJointImpedance", 5, 4, 4, 4},
    {Command::set_cartesian_impedance, "SetCartesianImpedance", 6, 5, 5, 5},
    {Command::set_guiding_mode, "SetGuidingMode", 7, 6, 6, 6},
    {Command::set_ee_to_k, "SetEEToK", 8, 7, 7, 7},
    {Command::set_ne_to_ee, "SetNEToEE", 9, 8, 8, 8},
    {Command::set_load, "SetLoad", 10, 9, 9, 9},
    {Command::set_filters, "SetFilters", 11, -1, -1, -1},
    {Command::automatic_error_recovery, "AutomaticErrorRecovery", 12, 10, 10, 10},
    {Command::load_model_library, "LoadModelLibrary", 13, 11, 11, -1},
    {Command::get_robot_model, "GetRobotModel", -1, -1, 12, 11},
}};

constexpr const CommandInfo& info(Command command) { return kCommands[static_cast<std::size_t>(command)]; }

constexpr std::optional<std::uint32_t> command_id(const Dialect& d, Command command) {
  const CommandInfo& i = info(command);
  const std::int8_t id = d.version >= 10  ? i.id_v10
                         : d.version >= 8 ? i.id_v8
                         : d.version >= 6 ? i.id_v6
                                          : i.id_v4;
  if (id < 0) return std::nullopt;
  return static_cast<std::uint32_t>(id);
}

constexpr std::optional<Command> command_of(const Dialect& d, std::uint32_t id) {
  for (const CommandInfo& i : kCommands)
    if (command_id(d, i.command) == id) return i.command;
  return std::nullopt;
}

static_assert([] {
  for (std::size_t i = 0; i < kCommandCount; ++i)
    if (kCommands[i].command != static_cast<Command>(i)) return false;
  for (const Dialect& d : kDialects) {
    if (command_of(d, 0) != Command::connect) return false;  // sent before a version is agreed on
    std::uint32_t known = 0;                                 // ids are without gaps
    while (command_of(d, known)) ++known;
    if (known != (d.version <= 5 ? 14u : d.version == 8 || d.version == 9 ? 13u : 12u)) return false;
  }
  return true;
}());

// Headers: the arm's has a command of 32 bits, those of gripper and vacuum gripper one of 16.
struct MessageHeader {
  std::uint32_t command = 0;
  std::uint32_t command_id = 0;  // counts up per connection
  std::uint32_t size = 0;        // of the whole message, header included [bytes]
};

enum class HeaderKind : std::uint8_t { arm, gripper };
constexpr std::size_t header_size(HeaderKind kind) { return kind == HeaderKind::arm ? 12 : 10; }
inline constexpr std::size_t kArmHeader = header_size(HeaderKind::arm);
inline constexpr std::size_t kGripperHeader = header_size(HeaderKind::gripper);

// Returns the header's size, or 0 if `to` is too small.
std::size_t encode(HeaderKind kind, const MessageHeader& header, std::span<std::byte> to);
[[nodiscard]] WireResult decode(HeaderKind kind, std::span<const std::byte> from, MessageHeader& header);

}  // namespace multipanda::fci
