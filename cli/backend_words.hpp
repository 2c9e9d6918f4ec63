#pragma once

#include <string>
#include <vector>

#include "cli/program.hpp"
#include "runtime/backends.hpp"

namespace multipanda::cli {

// --backend and --address, of every sub-command that runs arms.
struct BackendWords {
  std::string backend;                 // empty: as the scene says
  std::vector<std::string> addresses;  // "left=127.0.0.1"
};

void add_backend_words(CLI::App* command, BackendWords& words);
// Only simulated ones, for what begins anew with every run: no --address.
void add_simulation_words(CLI::App* command, BackendWords& words);

// Throws UsageError: not understood, or words that do not go together.
BackendOptions backend_options(const BackendWords& words);

}  // namespace multipanda::cli
