#pragma once

#include <filesystem>
#include <vector>

// Locations of multipanda's own files. No path of the build computer is compiled in: everything is found
// relative to the program, or to the library that contains this code. Off the loop only.
namespace multipanda {

// The folder with models, scenes, experiments and the scripts of pages: MULTIPANDA_SHARE, otherwise the
// nearest share/multipanda in the folders above the program. In a build, that is a link to the source folder.
// Throws std::runtime_error if there is none.
std::filesystem::path share_folder();

// The Python interpreter that draws pages: MULTIPANDA_PYTHON, otherwise that of the Python environment of the
// build or of the installation, otherwise the first on PATH. Throws std::runtime_error if there is none.
std::filesystem::path page_python();

// Folders that may contain Python packages with robot descriptions: the build's Python environment, or that
// of the installation.
std::vector<std::filesystem::path> python_package_folders();

// Instructions for missing Python packages of pages.
std::string page_packages_cure();

// What a library of this project exports under this name; it lies beside the core's, is loaded here, and
// stays. Throws std::runtime_error.
void* from_own_library(const char* library, const char* name);

// Instructions for missing ROS 2 interfaces or libraries.
std::string ros_cure();

}  // namespace multipanda
