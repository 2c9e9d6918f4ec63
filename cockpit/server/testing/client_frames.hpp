#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace multipanda::cockpit::test {

enum class Opcode : std::uint8_t { text = 1, binary = 2, close = 8, ping = 9, pong = 10 };

// A frame as a browser sends it: whole and masked (RFC 6455, section 5.2).
inline std::string client_frame(Opcode opcode, std::string_view data) {
  constexpr std::array<char, 4> kMask{'\x5a', '\x13', '\x00', '\x7f'};
  std::string frame{static_cast<char>(0x80 | static_cast<int>(opcode))};
  if (data.size() < 126) {
    frame += static_cast<char>(0x80 | data.size());
  } else {
    frame +=
        {static_cast<char>(0x80 | 126), static_cast<char>(data.size() >> 8), static_cast<char>(data.size())};
  }
  frame.append(kMask.data(), kMask.size());
  for (std::size_t i = 0; i < data.size(); ++i) frame += static_cast<char>(data[i] ^ kMask[i % 4]);
  return frame;
}

}  // namespace multipanda::cockpit::test
