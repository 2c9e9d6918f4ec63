#pragma once

#include <string>
#include <vector>

#include "cli/program.hpp"
#include "runtime/backends.hpp"

namespace multipanda::cli {

// --backend, --log and --address of the commands that run arms.
struct BackendArguments {
  std::string backend;                 // empty: as in the scene
  std::vector<std::string> addresses;  // "left=127.0.0.1"
  std::string log;                     // of the backend replay
};

void add_backend_arguments(CLI::App* command, BackendArguments& arguments);
// --backend and --address of experiments: simulated arms, virtual ones, or all of another process.
void add_experiment_arguments(CLI::App* command, BackendArguments& arguments);

// Throws UsageError for invalid arguments or a combination that is not allowed.
BackendOptions backend_options(const BackendArguments& arguments);

}  // namespace multipanda::cli
