#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

struct ScriptResult {
  bool good = false;   // started, and ended with 0
  std::string output;  // what it said, last part of it; or why it did not start
};

// Runs `program` with `arguments`, without a shell, with nothing to read, and waits for its end.
ScriptResult run_script(const std::filesystem::path& program, const std::vector<std::string>& arguments);

}  // namespace multipanda
