#pragma once

#include <filesystem>

#include "cli/console.hpp"
#include "runtime/summary.hpp"

namespace multipanda::cli {

// The log that DIR means: DIR itself if it is a file, the log inside, or that of the newest run inside.
// Throws UsageError if there is none.
std::filesystem::path find_log(const std::filesystem::path& directory);

// Makes the report of a log and says on the console what is missing in it, or why there is none. The page's
// path; empty if it failed. `run`: what the log cannot know, such as the thread set-up; may be left out.
std::filesystem::path report_of(const std::filesystem::path& log, const Console& console,
                                const RunSummary* run = nullptr);

}  // namespace multipanda::cli
