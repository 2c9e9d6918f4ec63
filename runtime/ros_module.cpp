#include "runtime/ros_module.hpp"

#include <dlfcn.h>
#include <stdexcept>

namespace multipanda {
namespace {

constexpr const char* kCure =
    "in the source tree run './multipanda setup' (without --no-ros), which fetches the ROS 2 wheels, and "
    "build again; "
    "wheel and .deb have no ROS 2 interfaces";

}  // namespace

std::filesystem::path ros_module_path() {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
  return (error ? std::filesystem::path(".") : program.parent_path()) / "libmultipanda_ros.so";
}

void* ros_module_function(const char* name, const std::filesystem::path& module) {
  if (!std::filesystem::exists(module)) {
    throw std::runtime_error("--ros: multipanda was built without ROS 2 (there is no " + module.string() +
                             "): " + kCure);
  }
  // RTLD_NOW and RTLD_LOCAL: symbols are resolved at once and stay hidden from the program. RTLD_DEEPBIND:
  // Fast DDS and the URDF reader bring two versions of tinyxml2, and each must find its own.
  void* library = dlopen(module.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_DEEPBIND);
  if (library == nullptr) {
    const char* why = dlerror();
    throw std::runtime_error(std::string("--ros: the ROS adapter cannot be loaded: ") +
                             (why != nullptr ? why : "no reason given") + "; " + kCure);
  }
  const auto version = reinterpret_cast<unsigned (*)()>(dlsym(library, "multipanda_ros_version"));
  void* function = dlsym(library, name);
  if (version == nullptr || function == nullptr || version() != kRosModuleVersion) {
    throw std::runtime_error("--ros: " + module.string() +
                             " does not belong to the same build as the program: build again");
  }
  return function;
}

MakeRunAdapter load_ros_adapter(RosArguments words, const std::filesystem::path& module) {
  const auto make = reinterpret_cast<RunAdapter* (*)(const RunContext&, const RosArguments&)>(
      ros_module_function("multipanda_make_ros_adapter", module));
  return [make, words = std::move(words)](const RunContext& run) {
    return std::unique_ptr<RunAdapter>(make(run, words));
  };
}

}  // namespace multipanda
