#include <optional>
#include <string>

#include "ros/adapter/ros_adapter.hpp"
#include "runtime/ros_module.hpp"

// What the program finds in libmultipanda_ros.so (runtime/ros_module.hpp).

extern "C" __attribute__((visibility("default"))) unsigned multipanda_ros_version() {
  return multipanda::kRosModuleVersion;
}

extern "C" __attribute__((visibility("default"))) multipanda::RunAdapter* multipanda_make_ros_adapter(
    const multipanda::RunWorld& world, const multipanda::RosWords& words) {
  multipanda::ros::RosOptions options;
  static_cast<multipanda::RosSection&>(options) = world.scene->ros;
  if (!words.node.empty()) options.node = words.node;
  if (!words.name_space.empty()) options.name_space = words.name_space;
  for (const auto& remap : words.remaps) {
    options.arguments.push_back("-r");
    options.arguments.push_back(remap);
  }
  return new multipanda::ros::RosAdapter(world, std::move(options));
}
