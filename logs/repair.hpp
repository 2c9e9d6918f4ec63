#pragma once

#include <cstdint>
#include <filesystem>

namespace multipanda {

struct RepairResult {
  bool was_complete = false;         // unchanged
  std::uint64_t messages = 0;        // in the file now
  std::uint64_t chunks_dropped = 0;  // unreadable inside the file
  std::uint64_t bytes_dropped = 0;   // at the end of a file without footer, after the last complete chunk
};

// Adds index and footer to the log of a killed process or a full disk, and leaves out chunks that cannot be
// read; complete chunks stay unchanged. With `closed_stays` a log with footer stays unchanged, too. The
// new file is written next to the old one and replaces it only when complete, so a failure leaves the old one
// unchanged. Throws std::runtime_error with the reason (not an MCAP file, still being written, no space,
// ...).
RepairResult repair_log(const std::filesystem::path& path, bool closed_stays = false);

}  // namespace multipanda
