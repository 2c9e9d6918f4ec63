#pragma once

#include <span>

#include "fci/wire/archive.hpp"
#include "fci/wire/commands.hpp"
#include "fci/wire/statuses.hpp"

// The gripper's connection (port kGripperPort): requests by TCP, answered when the motion is done; states by
// UDP, without commands. There is only one version. Its header is HeaderKind::gripper.
namespace multipanda::fci {

enum class GripperCommand : std::uint16_t { connect, homing, grasp, move, stop };

struct GripperConnectRequest {
  static constexpr GripperCommand kCommand = GripperCommand::connect;
  std::uint16_t version = kGripperVersion;
  std::uint16_t udp_port = 0;
};
struct GripperHomingRequest {
  static constexpr GripperCommand kCommand = GripperCommand::homing;
};
struct GripperGraspRequest {
  static constexpr GripperCommand kCommand = GripperCommand::grasp;
  double width = 0;                                     // of the object [m]
  double epsilon_inner = 0.005, epsilon_outer = 0.005;  // grasped within width - inner to width + outer [m]
  double speed = 0;                                     // [m/s]
  double force = 0;                                     // [N]
};
struct GripperMoveRequest {
  static constexpr GripperCommand kCommand = GripperCommand::move;
  double width = 0;  // [m]
  double speed = 0;  // [m/s]
};
struct GripperStopRequest {
  static constexpr GripperCommand kCommand = GripperCommand::stop;
};

struct GripperState {
  std::uint32_t message_id = 0;
  double width = 0;      // opening [m]
  double max_width = 0;  // found by homing [m]
  bool is_grasped = false;
  std::uint16_t temperature = 0;  // [deg C]
};

constexpr void carry(auto& a, MessageOf<GripperConnectRequest> auto& r) {
  a.integer("version", r.version);
  a.integer("udp_port", r.udp_port);
}
constexpr void carry(auto& a, MessageOf<GripperGraspRequest> auto& r) {
  a.number("width", r.width);
  a.number("epsilon_inner", r.epsilon_inner);
  a.number("epsilon_outer", r.epsilon_outer);
  a.number("speed", r.speed);
  a.number("force", r.force);
}
constexpr void carry(auto& a, MessageOf<GripperMoveRequest> auto& r) {
  a.number("width", r.width);
  a.number("speed", r.speed);
}
constexpr void carry(auto&, MessageOf<GripperHomingRequest> auto&) {}
constexpr void carry(auto&, MessageOf<GripperStopRequest> auto&) {}
constexpr void carry(auto& a, MessageOf<GripperState> auto& s) {
  a.integer("message_id", s.message_id);
  a.number("width", s.width);
  a.number("max_width", s.max_width);
  a.flag("is_grasped", s.is_grasped);
  a.integer("temperature", s.temperature);
}

// [bytes]: of a datagram, or of a request's payload
template <class Message>
constexpr std::size_t gripper_payload_size() {
  Measure a;
  const Message m{};
  carry(a, m);
  return a.size();
}
inline constexpr std::size_t kGripperStateSize = gripper_payload_size<GripperState>();
static_assert(kGripperStateSize == 23);
static_assert(kGripperHeader + gripper_payload_size<GripperConnectRequest>() == 14);
static_assert(kGripperHeader + gripper_payload_size<GripperHomingRequest>() == 10);
static_assert(kGripperHeader + gripper_payload_size<GripperGraspRequest>() == 50);
static_assert(kGripperHeader + gripper_payload_size<GripperMoveRequest>() == 26);
static_assert(kGripperHeader + gripper_payload_size<GripperStopRequest>() == 10);
inline constexpr std::size_t kMaxGripperRequestSize = 50;
inline constexpr std::size_t kGripperReplySize = 12, kGripperConnectReplySize = 14;

// Payloads and datagrams of gripper and vacuum gripper. Requests must have exactly their size, states may be
// longer. 0: no room.
template <class Message>
[[nodiscard]] WireResult decode_gripper(std::span<const std::byte> from, Message& message,
                                        bool exact = true) {
  Reader a(from);
  carry(a, message);
  return a.result(exact);
}
template <class Message>
std::size_t encode_gripper(const Message& message, std::span<std::byte> to) {
  Writer a(to);
  carry(a, message);
  return a.result() == WireResult::ok ? a.size() : 0;
}

// A whole request, header included. 0: no room.
template <class Request>
std::size_t encode_gripper_request(std::uint32_t command_id, const Request& request,
                                   std::span<std::byte> to) {
  constexpr std::size_t kSize = kGripperHeader + gripper_payload_size<Request>();
  if (to.size() < kSize) return 0;
  encode(HeaderKind::gripper, {static_cast<std::uint32_t>(Request::kCommand), command_id, kSize}, to);
  return kGripperHeader + encode_gripper(request, to.subspan(kGripperHeader));
}

// Whole replies of gripper and vacuum gripper; `command` is the request's number. 0: no room.
std::size_t encode_gripper_reply(std::uint16_t command, std::uint32_t command_id, GripperStatus status,
                                 std::span<std::byte> to);
// `status`: success, or fail if the version is different.
std::size_t encode_gripper_connect_reply(std::uint32_t command_id, GripperStatus status,
                                         std::uint16_t version, std::span<std::byte> to);
[[nodiscard]] WireResult decode_gripper_reply(std::span<const std::byte> payload, GripperStatus& status);
[[nodiscard]] WireResult decode_gripper_connect_reply(std::span<const std::byte> payload,
                                                      GripperStatus& status, std::uint16_t& version);

}  // namespace multipanda::fci
