#pragma once

#include <filesystem>

#include "cli/program.hpp"
#include "runtime/summary.hpp"

namespace multipanda::cli {

// The log in DIR: DIR itself if it is a file, the log inside, or that of the newest run inside. Throws
// UsageError if there is none.
std::filesystem::path find_log(const std::filesystem::path& directory);

// A log of multipanda as it is; another program's recording as a new log in runs/. Throws UsageError if it
// cannot be read.
std::filesystem::path own_log(const std::filesystem::path& log);

// Makes the report of a log; prints what is missing in it, or why it failed. Returns the path of the page,
// empty on failure. `run` adds information that the log lacks, such as the thread set-up; it may be null.
std::filesystem::path report_of(const std::filesystem::path& log, const Console& console,
                                const RunSummary* run = nullptr);

}  // namespace multipanda::cli
