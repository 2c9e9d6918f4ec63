#include "scene/carried_arms.hpp"

#include <algorithm>

namespace multipanda {

const SceneArm* carried_arm(const Scene& scene) {
  const auto found = std::find_if(scene.arms.begin(), scene.arms.end(),
                                  [](const SceneArm& arm) { return arm.mount.has_value(); });
  return found == scene.arms.end() ? nullptr : &*found;
}

void refuse_carried_arms(const Scene& scene, const std::string& what) {
  const SceneArm* arm = carried_arm(scene);
  if (arm == nullptr) return;
  SourcePlace place = arm->mount_place;
  if (place.file.empty()) place.file = scene.path.empty() ? scene.name : scene.path;
  throw CarriedArmRefused(
      place, "arm '" + arm->name + "' stands on arm '" + scene.arms.at(arm->mount->carrier).name +
                 "': " + what +
                 " cannot place a moving base; run it with `multipanda run` on the simulation "
                 "(backend mujoco)");
}

}  // namespace multipanda
