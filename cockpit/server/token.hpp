#pragma once

#include <string>
#include <string_view>

namespace multipanda::cockpit {

// 128 bits of the system's random numbers, as 32 hexadecimal digits. Throws std::runtime_error.
std::string make_token();

// Takes as long for any text, so that the time tells nothing about the token.
bool same_token(std::string_view given, std::string_view token);

}  // namespace multipanda::cockpit
