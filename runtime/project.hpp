#pragma once

#include <filesystem>

namespace multipanda {

// Where multipanda's own files stand (config/, analysis/, .venv): the folder in the environment variable
// MULTIPANDA_SHARE, else the one it was built from.
std::filesystem::path project_root();

}  // namespace multipanda
