#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>

#include "fci/wire/commands.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/gripper.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"
#include "fci/wire/statuses.hpp"

namespace multipanda::fci {

std::size_t encode(HeaderKind kind, const MessageHeader& header, std::span<std::byte> to) {
  Writer a(to);
  if (kind == HeaderKind::arm)
    a.integer("command", header.command);
  else
    a.integer("command", static_cast<std::uint16_t>(header.command));
  a.integer("command_id", header.command_id);
  a.integer("size", header.size);
  return a.result() == WireResult::ok ? a.size() : 0;
}

WireResult decode(HeaderKind kind, std::span<const std::byte> from, MessageHeader& header) {
  Reader a(from);
  if (kind == HeaderKind::arm) {
    a.integer("command", header.command);
  } else {
    std::uint16_t command = 0;
    a.integer("command", command);
    header.command = command;
  }
  a.integer("command_id", header.command_id);
  a.integer("size", header.size);
  return a.result(false);
}

std::size_t encode_reply(const Dialect& d, Command command, std::uint32_t command_id, Status status,
                         std::span<std::byte> to, std::size_t more) {
  const auto id = fci::command_id(d, command);
  constexpr std::size_t kSize = kArmHeader + 1;
  if (!id || to.size() < kSize) return 0;
  encode(HeaderKind::arm, {*id, command_id, static_cast<std::uint32_t>(kSize + more)}, to);
  to[kArmHeader] = static_cast<std::byte>(status_byte(d, command, status));
  return kSize;
}

std::size_t encode_connect_reply(std::uint32_t command_id, Status status, std::uint16_t version,
                                 std::span<std::byte> to) {
  const Dialect& any = kDialects.back();
  if (to.size() < kArmHeader + 3) return 0;
  const std::size_t size = encode_reply(any, Command::connect, command_id, status, to, sizeof(version));
  Writer a(to.subspan(size));
  a.integer("version", version);
  return size + a.size();
}

std::size_t encode(const Dialect& d, const CartesianLimit& limit, std::span<std::byte> to) {
  Writer a(to);
  carry(a, limit, d);
  return a.result() == WireResult::ok ? a.size() : 0;
}

WireResult decode_reply(const Dialect& d, Command command, std::span<const std::byte> payload, Status& status,
                        std::span<const std::byte>& rest) {
  if (payload.empty()) return WireResult::too_short;
  const auto known = status_of(d, command, static_cast<std::uint8_t>(payload.front()));
  if (!known) return WireResult::bad_value;
  status = *known;
  rest = payload.subspan(1);
  return WireResult::ok;
}

WireResult decode_connect_reply(std::span<const std::byte> payload, Status& status, std::uint16_t& version) {
  std::span<const std::byte> rest;
  const WireResult result = decode_reply(kDialects.back(), Command::connect, payload, status, rest);
  if (result != WireResult::ok) return result;
  Reader a(rest);
  a.integer("version", version);
  return a.result(false);
}

std::size_t encode_gripper_reply(std::uint16_t command, std::uint32_t command_id, GripperStatus status,
                                 std::span<std::byte> to) {
  if (to.size() < kGripperReplySize) return 0;
  encode(HeaderKind::gripper, {command, command_id, kGripperReplySize}, to);
  Writer a(to.subspan(kGripperHeader));
  a.choice("status", status, GripperStatus::aborted);
  return kGripperReplySize;
}

std::size_t encode_gripper_connect_reply(std::uint32_t command_id, GripperStatus status,
                                         std::uint16_t version, std::span<std::byte> to) {
  if (to.size() < kGripperConnectReplySize) return 0;
  encode(HeaderKind::gripper, {0, command_id, kGripperConnectReplySize}, to);
  Writer a(to.subspan(kGripperHeader));
  a.choice("status", status, GripperStatus::aborted);
  a.integer("version", version);
  return kGripperConnectReplySize;
}

WireResult decode_gripper_reply(std::span<const std::byte> payload, GripperStatus& status) {
  Reader a(payload);
  a.choice("status", status, GripperStatus::aborted);
  return a.result(false);
}

WireResult decode_gripper_connect_reply(std::span<const std::byte> payload, GripperStatus& status,
                                        std::uint16_t& version) {
  Reader a(payload);
  a.choice("status", status, GripperStatus::aborted);
  a.integer("version", version);
  return a.result(false);
}

std::size_t encode(const Dialect& d, const RobotState& state, std::span<std::byte> to) {
  Writer a(to, d.is_single_precision());
  carry_state(a, state, d);
  return a.result() == WireResult::ok ? a.size() : 0;
}

std::size_t encode(const Dialect& d, const RobotCommand& command, std::span<std::byte> to) {
  Writer a(to);
  carry_command(a, command, d);
  return a.result() == WireResult::ok ? a.size() : 0;
}

WireResult decode(const Dialect& d, std::span<const std::byte> from, RobotState& state) {
  Reader a(from, d.is_single_precision());
  carry_state(a, state, d);
  if (const WireResult result = a.result(false); result != WireResult::ok) return result;
  const bool defined = state.motion_generator_mode <= static_cast<std::uint8_t>(MotionGeneratorMode::none) &&
                       state.controller_mode <= static_cast<std::uint8_t>(ControllerMode::other) &&
                       state.robot_mode <= static_cast<std::uint8_t>(RobotMode::automatic_error_recovery);
  return defined ? WireResult::ok : WireResult::bad_value;
}

WireResult decode(const Dialect& d, std::span<const std::byte> from, RobotCommand& command) {
  Reader a(from);
  carry_command(a, command, d);
  return a.result(true);
}

std::string_view text(Status status) {
  switch (status) {
    case Status::success:
      return "done";
    case Status::motion_started:
      return "motion started";
    case Status::preempted:
      return "motion stopped on request";
    case Status::preempted_by_safety:
      return "motion stopped by a safety function";
    case Status::rejected_by_safety:
      return "rejected: a safety function is active";
    case Status::not_possible:
      return "rejected: not possible in the arm's current mode";
    case Status::singular:
      return "rejected: the motion would begin at a singular pose";
    case Status::invalid_argument:
      return "rejected: invalid argument";
    case Status::reflex_aborted:
      return "stopped by a reflex";
    case Status::emergency_aborted:
      return "stopped by the user stop";
    case Status::input_error_aborted:
      return "stopped: a command was invalid";
    case Status::aborted:
      return "aborted";
    case Status::manual_recovery_required:
      return "rejected: the arm must be moved by hand first";
    case Status::incompatible_version:
      return "the arm uses a different version of the protocol";
    case Status::error:
      return "the arm has no model for this computer";
  }
  return "unknown status";
}

FrameReader::FrameReader(HeaderKind kind, std::size_t max_size, std::size_t reserve)
    : kind_(kind), max_size_(max_size), buffer_(std::max<std::size_t>(reserve, 2 * header_size(kind))) {
  if (max_size < header_size(kind))
    throw std::invalid_argument("FrameReader: max_size must hold a header of " +
                                std::to_string(header_size(kind)) + " bytes, got " +
                                std::to_string(max_size));
}

std::span<std::byte> FrameReader::room() {
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, waiting());
    end_ -= begin_;
    begin_ = 0;
  }
  // Full: one incomplete message, unless the caller has not fetched complete ones.
  if (end_ == buffer_.size() && end_ < max_size_) buffer_.resize(std::min(2 * end_, max_size_));
  return std::span(buffer_).subspan(end_);
}

void FrameReader::received(std::size_t bytes) { end_ = std::min(end_ + bytes, buffer_.size()); }

FrameReader::Next FrameReader::next(Message& message) {
  if (broken_) return Next::bad_size;
  MessageHeader header;
  const auto there = std::span<const std::byte>(buffer_).subspan(begin_, waiting());
  if (decode(kind_, there, header) != WireResult::ok) return Next::incomplete;
  if (header.size < header_size(kind_) || header.size > max_size_) {
    broken_ = true;
    return Next::bad_size;
  }
  if (header.size > there.size()) return Next::incomplete;
  message = {header.command, header.command_id,
             there.subspan(header_size(kind_), header.size - header_size(kind_))};
  begin_ += header.size;
  return Next::message;
}

void FrameReader::reset() {
  begin_ = end_ = 0;
  broken_ = false;
}

}  // namespace multipanda::fci
