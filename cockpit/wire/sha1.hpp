#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace multipanda::cockpit {

// FIPS 180-4, for the handshake of WebSockets (RFC 6455, section 1.3), which needs no strong hash.
std::array<std::uint8_t, 20> sha1(std::string_view text);

// RFC 4648, with padding.
std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace multipanda::cockpit
