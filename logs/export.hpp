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

}  // namespace multipanda
