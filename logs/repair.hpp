#pragma once

#include <cstdint>
#include <filesystem>

namespace multipanda {

struct RepairResult {
  bool was_complete = false;         // it already had its footer: nothing was changed
  std::uint64_t messages = 0;        // in the file now
  std::uint64_t chunks_dropped = 0;  // unreadable inside the file
  std::uint64_t bytes_dropped = 0;   // at the end, after the last complete chunk
};

// Gives the log of a killed process, or of a full disk, its index and footer, and keeps every complete chunk
// unchanged. The new file is written next to the old one and replaces it only when it is complete, so a
// failure leaves the old one unchanged. Throws std::runtime_error with the reason (not an MCAP file, still
// being written, no space, ...).
RepairResult repair_log(const std::filesystem::path& path);

}  // namespace multipanda
