#include "ros/adapter/state/scene_description.hpp"

#include "models/write_robot.hpp"
#include "scene/build.hpp"

namespace multipanda::ros {

std::string scene_urdf(const Scene& scene) {
  std::vector<PlacedRobot> arms;
  for (const auto& arm : scene.arms) {
    PlacedRobot placed{.robot = robot_of(arm), .X_WB = arm.X_WB};
    placed.options = {.hand = arm.hand,
                      .fingers = true,
                      .prefix = arm.name + "_",
                      .flange = "link" + std::to_string(placed.robot.joint_count() + 1)};
    arms.push_back(std::move(placed));
  }
  return to_urdf(scene.name, arms);
}

}  // namespace multipanda::ros
