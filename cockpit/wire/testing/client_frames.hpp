#pragma once

#include <array>
#include <string>
#include <string_view>

#include "cockpit/wire/websocket.hpp"

namespace multipanda::cockpit::test {

// A frame as a browser sends it: masked.
inline std::string client_frame(Opcode opcode, std::string_view data, bool last = true) {
  constexpr std::array<char, 4> kMask{'\x5a', '\x13', '\x00', '\x7f'};
  std::string frame = frame_head(opcode, data.size());
  if (!last) frame[0] = static_cast<char>(frame[0] & 0x7f);
  frame[1] = static_cast<char>(frame[1] | 0x80);
  frame.append(kMask.data(), kMask.size());
  for (std::size_t i = 0; i < data.size(); ++i) frame += static_cast<char>(data[i] ^ kMask[i % 4]);
  return frame;
}

}  // namespace multipanda::cockpit::test
