#include <dlfcn.h>
#include <stdexcept>

#include "common/own_files.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

constexpr const char* kInPackage = "../lib/ros";  // from the folder of the program, in a wheel

// A wheel's module is linked with the libraries of ENV/lib, where pip has put the packages of the extra
// `ros`; the module is in ENV/lib/python3.x/site-packages/multipanda/lib/ros. A library of the same name
// elsewhere, such as that of a ROS 2 set up in the shell, may be another version.
void check_packaged_libraries(const fs::path& module) {
  const fs::path folder = module.parent_path();
  if (folder.filename() != "ros" || folder.parent_path().filename() != "lib") return;
  const fs::path library = (folder / "../../../../.." / "librcl.so").lexically_normal();
  if (!fs::exists(library)) {
    throw std::runtime_error("--ros: the ROS 2 libraries are not installed (there is no " + library.string() +
                             "): " + ros_cure());
  }
}

}  // namespace

fs::path ros_module_path() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  const fs::path folder = error ? fs::path(".") : program.parent_path();
  const fs::path packaged = (folder / kInPackage / "libmultipanda_ros.so").lexically_normal();
  return fs::exists(packaged, error) ? packaged : folder / "libmultipanda_ros.so";
}

void* ros_module_function(const char* name, const fs::path& module) {
  if (!fs::exists(module)) {
    throw std::runtime_error("--ros: multipanda was built without ROS 2 (there is no " + module.string() +
                             "): " + ros_cure());
  }
  check_packaged_libraries(module);
  // RTLD_NOW and RTLD_LOCAL: symbols are resolved at once and stay hidden from the program. RTLD_DEEPBIND:
  // Fast DDS and the URDF reader bring two versions of tinyxml2, and each must find its own.
  void* library = dlopen(module.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_DEEPBIND);
  if (library == nullptr) {
    const char* why = dlerror();
    throw std::runtime_error(std::string("--ros: the ROS adapter cannot be loaded: ") +
                             (why != nullptr ? why : "no reason given") + "; " + ros_cure());
  }
  const auto version = reinterpret_cast<unsigned (*)()>(dlsym(library, "multipanda_ros_version"));
  void* function = dlsym(library, name);
  if (version == nullptr || function == nullptr || version() != kRosModuleVersion) {
    throw std::runtime_error("--ros: " + module.string() +
                             " does not belong to the same build as the program: build again");
  }
  return function;
}

MakeRunAdapter load_ros_adapter(RosArguments words, const fs::path& module) {
  const auto make = reinterpret_cast<RunAdapter* (*)(const RunContext&, const RosArguments&)>(
      ros_module_function("multipanda_make_ros_adapter", module));
  return [make, words = std::move(words)](const RunContext& run) {
    return std::unique_ptr<RunAdapter>(make(run, words));
  };
}

}  // namespace multipanda
