#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "fci/wire/commands.hpp"

// The answer to a request: one byte whose meaning depends on request and version. Here one enumeration covers
// all of them.
namespace multipanda::fci {

enum class Status : std::uint8_t {
  success,
  motion_started,       // first reply to Move; a second one follows when the motion ends
  preempted,            // stopped on request
  preempted_by_safety,  // stopped by a safety function
  rejected_by_safety,   // a safety function is active
  not_possible,         // not in the arm's current mode
  singular,             // motion would begin at a singular pose
  invalid_argument,
  reflex_aborted,       // an error of the motion stopped it
  emergency_aborted,    // the user stop did
  input_error_aborted,  // a command was not valid
  aborted,
  manual_recovery_required,  // the arm must be moved by hand first
  incompatible_version,      // of Connect
  error,                     // of LoadModelLibrary
};
inline constexpr std::size_t kStatusCount = 15;

// Reason in lower case, without a period.
std::string_view text(Status status);

namespace detail {

// A list of statuses: the byte is the index.
struct StatusList {
  std::array<Status, 12> values{};
  std::uint8_t count = 0;

  template <class... S>
  constexpr explicit StatusList(S... s) : values{s...}, count(sizeof...(s)) {}
};

using enum Status;
inline constexpr StatusList kConnectStatuses(success, incompatible_version);
inline constexpr StatusList kLibraryStatuses(success, error);
inline constexpr StatusList kPlainV4(success, not_possible);
inline constexpr StatusList kPlainV6(success, not_possible, rejected_by_safety);
inline constexpr StatusList kSetterV4(success, not_possible, invalid_argument);
inline constexpr StatusList kSetterV6(success, not_possible, invalid_argument, rejected_by_safety);
inline constexpr StatusList kMoveV4(success, motion_started, preempted, not_possible, singular,
                                    invalid_argument, reflex_aborted, emergency_aborted, input_error_aborted,
                                    aborted);
inline constexpr StatusList kMoveV6(success, motion_started, preempted, preempted_by_safety,
                                    rejected_by_safety, not_possible, singular, invalid_argument,
                                    reflex_aborted, emergency_aborted, input_error_aborted, aborted);
inline constexpr StatusList kStopV4(success, not_possible, emergency_aborted, reflex_aborted, aborted);
inline constexpr StatusList kStopV6(success, not_possible, rejected_by_safety, emergency_aborted,
                                    reflex_aborted, aborted);
inline constexpr StatusList kRecoveryV4(success, not_possible, manual_recovery_required, reflex_aborted,
                                        emergency_aborted, aborted);
inline constexpr StatusList kRecoveryV6(success, not_possible, rejected_by_safety, manual_recovery_required,
                                        reflex_aborted, emergency_aborted, aborted);

constexpr const StatusList& statuses(const Dialect& d, Command command) {
  const bool safety = d.has_safety_statuses();
  switch (command) {
    case Command::connect:
      return kConnectStatuses;
    case Command::move:
      return safety ? kMoveV6 : kMoveV4;
    case Command::stop_move:
      return safety ? kStopV6 : kStopV4;
    case Command::automatic_error_recovery:
      return safety ? kRecoveryV6 : kRecoveryV4;
    case Command::load_model_library:
      return kLibraryStatuses;
    case Command::get_robot_model:
      return safety ? kPlainV6 : kPlainV4;
    case Command::get_cartesian_limit:
    case Command::set_collision_behavior:
    case Command::set_joint_impedance:
    case Command::set_cartesian_impedance:
    case Command::set_guiding_mode:
    case Command::set_ee_to_k:
    case Command::set_ne_to_ee:
    case Command::set_load:
    case Command::set_filters:
      break;
  }
  return safety ? kSetterV6 : kSetterV4;
}

}  // namespace detail

// The byte for exactly this status, if the version's reply to `command` has it.
constexpr std::optional<std::uint8_t> exact_status_byte(const Dialect& d, Command command, Status status) {
  const detail::StatusList& list = detail::statuses(d, command);
  for (std::uint8_t i = 0; i < list.count; ++i)
    if (list.values[i] == status) return i;
  return std::nullopt;
}

// None: the byte is outside the enumeration, so the reply violates the protocol.
constexpr std::optional<Status> status_of(const Dialect& d, Command command, std::uint8_t byte) {
  const detail::StatusList& list = detail::statuses(d, command);
  if (byte >= list.count) return std::nullopt;
  return list.values[byte];
}

// The byte for this status, or for the nearest one that the reply can express: a refusal remains a refusal,
// and the end of a motion remains an end.
constexpr std::uint8_t status_byte(const Dialect& d, Command command, Status status) {
  using enum Status;
  if (const auto byte = exact_status_byte(d, command, status)) return *byte;
  const bool ending = status == preempted_by_safety || status == reflex_aborted ||
                      status == emergency_aborted || status == input_error_aborted ||
                      status == manual_recovery_required;
  const Status nearest = status == preempted_by_safety ? preempted : ending ? aborted : not_possible;
  if (const auto byte = exact_status_byte(d, command, nearest)) return *byte;
  return 1;  // the first refusal of every list, except that of Move, which has both
}

// Gripper and vacuum gripper: 16 bits, the same for all requests.
enum class GripperStatus : std::uint16_t {
  success,       // done
  fail,          // failed
  unsuccessful,  // executed without the expected result: nothing grasped
  aborted,       // by Stop or another request
};

}  // namespace multipanda::fci
