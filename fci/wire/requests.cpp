#include "fci/wire/requests.hpp"

namespace multipanda::fci {

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

}  // namespace multipanda::fci
