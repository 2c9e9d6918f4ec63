#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "models/export_list.hpp"
#include "models/to_xacro.hpp"

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
// Without it into models/generated of the project, and their xacro macros into ros/multipanda_description;
// tests keep both in step.
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
