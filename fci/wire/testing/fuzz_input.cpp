#include "fci/wire/testing/fuzz_input.hpp"

#include <algorithm>
#include <cstring>

#include "fci/wire/frame_reader.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci {
namespace {

using Bytes = std::span<const std::byte>;

// Writing what was read gives the same bytes again.
template <class Message, class Decode, class Encode>
bool settles(Bytes input, const Decode& decode_it, const Encode& encode_it) {
  Message first;
  if (decode_it(input, first) != WireResult::ok) return true;
  std::array<std::byte, kMaxStateSize> once, twice;
  const std::size_t size = encode_it(first, once);
  if (size == 0 || size > input.size()) return false;
  Message second;
  if (decode_it(Bytes(once).first(size), second) != WireResult::ok) return false;
  return encode_it(second, twice) == size && std::memcmp(once.data(), twice.data(), size) == 0;
}

template <class R>
bool request_settles(const Dialect& d, Bytes payload) {
  if (payload.empty()) return true;  // nothing to compare
  return settles<R>(
      payload, [&](Bytes from, R& r) { return decode_request(d, from, r); },
      [&](const R& r, std::span<std::byte> to) {
        std::array<std::byte, kMaxRequestSize> whole;
        const std::size_t size = encode_request(d, 7, r, whole);
        if (size < kArmHeader) return std::size_t{0};
        std::copy(whole.begin() + kArmHeader, whole.begin() + static_cast<std::ptrdiff_t>(size), to.begin());
        return size - kArmHeader;
      });
}

bool request_survives(const Dialect& d, Command command, Bytes payload) {
  switch (command) {
    case Command::connect:
      return request_settles<ConnectRequest>(d, payload);
    case Command::move:
      return request_settles<MoveRequest>(d, payload);
    case Command::get_cartesian_limit:
      return request_settles<GetCartesianLimitRequest>(d, payload);
    case Command::set_collision_behavior:
      return request_settles<SetCollisionBehaviorRequest>(d, payload);
    case Command::set_joint_impedance:
      return request_settles<SetJointImpedanceRequest>(d, payload);
    case Command::set_cartesian_impedance:
      return request_settles<SetCartesianImpedanceRequest>(d, payload);
    case Command::set_guiding_mode:
      return request_settles<SetGuidingModeRequest>(d, payload);
    case Command::set_ee_to_k:
      return request_settles<SetEEToKRequest>(d, payload);
    case Command::set_ne_to_ee:
      return request_settles<SetNEToEERequest>(d, payload);
    case Command::set_load:
      return request_settles<SetLoadRequest>(d, payload);
    case Command::set_filters:
      return request_settles<SetFiltersRequest>(d, payload);
    case Command::load_model_library:
      return request_settles<LoadModelLibraryRequest>(d, payload);
    case Command::stop_move:
    case Command::automatic_error_recovery:
    case Command::get_robot_model:
      break;
  }
  StopMoveRequest none;
  return (decode_request(d, payload, none) == WireResult::ok) == payload.empty();
}

template <class M>
bool gripper_settles(Bytes payload) {
  if (payload.empty()) return true;
  return settles<M>(
      payload, [](Bytes from, M& m) { return decode_gripper(from, m, false); },
      [](const M& m, std::span<std::byte> to) { return encode_gripper(m, to); });
}

bool payload_survives(const Dialect& d, HeaderKind kind, std::uint32_t command_number, Bytes payload) {
  bool well = true;
  if (kind == HeaderKind::arm) {
    const auto command = command_of(d, command_number);
    if (command) {
      well &= request_survives(d, *command, payload);
      Status status = Status::success;
      Bytes rest;
      if (decode_reply(d, *command, payload, status, rest) == WireResult::ok)
        well &= status_byte(d, *command, status) == static_cast<std::uint8_t>(payload.front());
    }
    Status status = Status::success;
    std::uint16_t version = 0;
    well &= decode_connect_reply(payload, status, version) != WireResult::too_long;
    return well;
  }
  well &= gripper_settles<GripperConnectRequest>(payload) && gripper_settles<GripperGraspRequest>(payload) &&
          gripper_settles<GripperMoveRequest>(payload) && gripper_settles<VacuumRequest>(payload) &&
          gripper_settles<VacuumDropOffRequest>(payload);
  GripperStatus status = GripperStatus::success;
  std::uint16_t version = 0;
  well &= decode_gripper_reply(payload, status) != WireResult::too_long;
  well &= decode_gripper_connect_reply(payload, status, version) != WireResult::too_long;
  return well;
}

bool stream_survives(const Dialect& d, HeaderKind kind, std::size_t chunk, Bytes stream) {
  FrameReader reader(kind, kMaxRequestSize, 64);
  bool well = true;
  std::size_t handed_out = 0;
  const std::size_t length = stream.size();
  while (!stream.empty()) {
    const auto room = reader.room();
    const std::size_t n = std::min({chunk, stream.size(), room.size()});
    if (n == 0) return false;  // an incomplete message that can never become complete
    std::copy_n(stream.begin(), n, room.begin());
    reader.received(n);
    stream = stream.subspan(n);
    Message message;
    FrameReader::Next next{};
    while ((next = reader.next(message)) == FrameReader::Next::message) {
      handed_out += header_size(kind) + message.payload.size();
      well &= payload_survives(d, kind, message.command, message.payload);
    }
    if (next == FrameReader::Next::bad_size) return well && handed_out < length;
  }
  return well && handed_out + reader.waiting() == length;
}

}  // namespace

// The first byte chooses version and header, the second how many bytes arrive at a time.
bool survives(Bytes input) {
  if (input.size() < 2) return true;
  const auto choice = std::to_integer<unsigned>(input[0]);
  const Dialect& d = kDialects[choice % kDialects.size()];
  const HeaderKind kind = choice < 128 ? HeaderKind::arm : HeaderKind::gripper;
  const std::size_t chunk = 1 + std::to_integer<std::size_t>(input[1]);
  const Bytes rest = input.subspan(2);

  bool well = stream_survives(d, kind, chunk, rest) && payload_survives(d, kind, choice % 16, rest);
  const auto read_datagram = [&](Bytes from, auto& m) { return decode(d, from, m); };
  const auto write_datagram = [&](const auto& m, std::span<std::byte> to) { return encode(d, m, to); };
  well &= settles<RobotState>(rest, read_datagram, write_datagram);
  well &= settles<RobotCommand>(rest, read_datagram, write_datagram);
  return well && gripper_settles<GripperState>(rest) && gripper_settles<VacuumState>(rest);
}

}  // namespace multipanda::fci
