#pragma once

#include <cstdint>
#include <filesystem>

namespace multipanda {

struct RepairResult {
  bool was_complete = false;         // had its footer already: nothing was changed
  std::uint64_t messages = 0;        // in the file now
  std::uint64_t chunks_dropped = 0;  // unreadable inside the file
  std::uint64_t bytes_dropped = 0;   // at the end, behind the last whole chunk
};

// Gives the log of a killed process, or of a full disk, its index and footer: every whole chunk is kept as it
// is. The new file is written beside the old one and takes its place only when it is complete, so a failure
// leaves the old one as it was. Throws std::runtime_error saying why (no MCAP file, still being written, no
// room, ...).
RepairResult repair_log(const std::filesystem::path& path);

}  // namespace multipanda
