#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

struct ExportResult {
  std::vector<std::filesystem::path> files;
  std::uint64_t messages = 0;
  std::vector<std::string> notes;  // what the files lack, and why
};

// Both functions read the log as far as it is complete, with or without a footer, in two passes (sizes,
// values). They need little memory for logs of any length. They throw std::runtime_error with the reason if
// nothing can be read or written.

// Writes one table per topic: "/left/state" becomes DIRECTORY/left_state.csv. The first column is t_s. Names
// end with the unit, and elements of lists count from 1: "q_1_rad", "pose_position_x_m".
ExportResult export_csv(const std::filesystem::path& log, const std::filesystem::path& directory);

// Writes one archive of arrays for numpy.load(): "left/state/t" (N), "left/state/q" (N x joints), ...; and
// whole messages as JSON in "events/json", "switches/json", "interventions/json".
ExportResult export_npz(const std::filesystem::path& log, const std::filesystem::path& file);

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
