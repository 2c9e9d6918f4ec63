#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

struct ExportResult {
  std::vector<std::filesystem::path> files;
  std::uint64_t messages = 0;
  std::vector<std::string> notes;  // what is not in the files, and why
};

// Both read the log as far as it is whole, with or without a footer, in two passes (sizes, values), and need
// little memory however long it is. They throw std::runtime_error saying why when nothing can be read or
// written.

// One table per topic: "/left/state" becomes DIRECTORY/left_state.csv. First column t [s]; fields with
// several numbers become name_0, name_1, ...
ExportResult export_csv(const std::filesystem::path& log, const std::filesystem::path& directory);

// One archive of arrays for numpy.load(): "left/state/t" (N), "left/state/q" (N x joints), ...; whole
// messages as JSON in "events/json", "switches/json", "interventions/json".
ExportResult export_npz(const std::filesystem::path& log, const std::filesystem::path& file);

}  // namespace multipanda
