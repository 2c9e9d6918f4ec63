#include "fci/wire/commands.hpp"

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

}  // namespace multipanda::fci
