#include "fci/wire/gripper.hpp"

namespace multipanda::fci {

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

}  // namespace multipanda::fci
