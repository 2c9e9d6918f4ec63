#pragma once

#include <cstdint>
#include <span>

namespace multipanda::fci {

// What a stranger may send, through everything that reads it: frames of all three ports, requests and replies
// of every version, all datagrams. False where something that was read does not read the same when written
// again. Reading outside the input is for the sanitizers to find.
bool survives(std::span<const std::byte> input);

}  // namespace multipanda::fci
