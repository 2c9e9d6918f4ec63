#pragma once

#include <filesystem>
#include <vector>

// Where multipanda's own files are. No path of the computer that built the program is compiled in: everything
// is found from the place of the program, or of the library that contains this code. Off the loop only.
namespace multipanda {

// The folder with models, scenes, experiments and the scripts of pages: MULTIPANDA_SHARE, otherwise the
// nearest share/multipanda in the folders above the program. In a build, that is a link to the source folder.
// Throws std::runtime_error if there is none.
std::filesystem::path share_folder();

// The Python interpreter that draws pages: MULTIPANDA_PYTHON, otherwise that of the Python environment of the
// build or of the installation, otherwise the first on PATH. Throws std::runtime_error if there is none.
std::filesystem::path page_python();

// Folders in which Python packages with robot descriptions may be: the build's Python environment, or the one
// that multipanda is installed in.
std::vector<std::filesystem::path> python_package_folders();

// What a user does if Python packages that pages need are missing.
std::string page_packages_cure();

// What a user does if the ROS 2 interfaces, or the ROS 2 libraries that they need, are missing.
std::string ros_cure();

}  // namespace multipanda
