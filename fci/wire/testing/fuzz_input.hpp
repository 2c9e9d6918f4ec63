#pragma once

#include <cstdint>
#include <span>

namespace multipanda::fci {

// Arbitrary input to every reader: frames of all three ports, requests and replies
// of every version, all datagrams. False if something that was read differs after writing and reading again.
// Sanitizers detect reads outside the input.
bool survives(std::span<const std::byte> input);

}  // namespace multipanda::fci
