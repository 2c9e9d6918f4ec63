#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "models/export_list.hpp"

// Writes the URDF and MJCF of the shipped robots into a folder: export_models [FOLDER].
// The default is models/generated of the project, whose files are kept in step by a test.
int main(int argc, char** argv) {
  using namespace multipanda;
  try {
    const std::filesystem::path folder =
        argc > 1 ? std::filesystem::path(argv[1]) : models_folder() / "generated";
    std::filesystem::create_directories(folder);
    for (const auto& [name, text] : exported_models()) {
      std::ofstream file(folder / name, std::ios::binary);
      file << text;
      if (!file.flush()) throw std::runtime_error("cannot write " + (folder / name).string());
      std::cout << (folder / name).string() << "\n";
    }
  } catch (const std::exception& error) {
    std::cerr << "export_models: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
