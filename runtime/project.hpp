#pragma once

#include <filesystem>

namespace multipanda {

// The folder with multipanda's own files (config/, report/, .venv): the environment variable
// MULTIPANDA_SHARE, or the source folder of the build.
std::filesystem::path project_root();

}  // namespace multipanda
