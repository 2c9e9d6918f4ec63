#include <optional>
#include <string>

#include "ros/adapter/ros_adapter.hpp"
#include "runtime/run_adapter.hpp"

// Symbols looked up in libmultipanda_ros.so by the program (runtime/run_adapter.hpp).

extern "C" __attribute__((visibility("default"))) unsigned multipanda_ros_version() {
  return multipanda::kRosModuleVersion;
}

extern "C" __attribute__((visibility("default"))) multipanda::RunAdapter* multipanda_make_ros_adapter(
    const multipanda::RunContext& run, const multipanda::RosArguments& arguments) {
  multipanda::ros::RosOptions options;
  static_cast<multipanda::RosSection&>(options) = run.scene->ros;
  if (!arguments.node.empty()) options.node = arguments.node;
  if (!arguments.name_space.empty()) options.name_space = arguments.name_space;
  for (const auto& remap : arguments.remaps) {
    options.arguments.push_back("-r");
    options.arguments.push_back(remap);
  }
  return new multipanda::ros::RosAdapter(run, std::move(options));
}
