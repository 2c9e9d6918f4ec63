#include "ros/adapter/scene_interfaces.hpp"

#include <algorithm>

#include "ros/adapter/interfaces_page.hpp"
#include "ros/adapter/ros_adapter.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::ros {

std::string scene_interface_tables(const std::string& name) {
  OpenedScene opened = open_scene(name);
  for (auto& arm : opened.scene.arms) {
    if (arm.hand) arm.movable_fingers = true;  // so that the page lists the gripper
  }
  const Scene scene = opened.scene;
  std::vector<std::string> features;
  for (const auto& type : opened.registry.features()) features.push_back(type.descriptor.type);
  RosAdapter* adapter = nullptr;
  SessionOptions options;
  options.make_adapter = [&](const RunContext& run) {
    RosOptions ros;
    static_cast<RosSection&>(ros) = run.scene->ros;
    auto made = std::make_unique<RosAdapter>(run, std::move(ros));
    adapter = made.get();
    return made;
  };
  const Session session(std::move(opened.scene), opened.registry, std::move(options));
  return interfaces_markdown(adapter->node().entities(), adapter->node().full_name(), scene, features);
}

}  // namespace multipanda::ros
