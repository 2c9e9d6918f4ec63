#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "models/write_robot.hpp"

namespace {

void write(const std::filesystem::path& folder, const std::map<std::string, std::string>& files) {
  std::filesystem::create_directories(folder);
  for (const auto& [name, text] : files) {
    std::ofstream file(folder / name, std::ios::binary);
    file << text;
    if (!file.flush()) throw std::runtime_error("cannot write " + (folder / name).string());
    std::cout << (folder / name).string() << "\n";
  }
}

}  // namespace

// Writes the URDF and MJCF of the shipped robots into a folder: export_models [FOLDER].
// Default: models/generated of the project, and their xacro macros in ros/multipanda_description; tests check
// that both are up to date.
int main(int argc, char** argv) {
  using namespace multipanda;
  try {
    write(argc > 1 ? std::filesystem::path(argv[1]) : models_folder() / "generated", exported_models());
    if (argc == 1) {
      write(models_folder().parent_path() / "ros/multipanda_description/urdf/generated",
            exported_descriptions());
    }
  } catch (const std::exception& error) {
    std::cerr << "export_models: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
