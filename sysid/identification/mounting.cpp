#include "sysid/identification/mounting.hpp"

#include <stdexcept>

#include "sysid/measured/scene_model.hpp"

namespace multipanda {
namespace {

void add(std::optional<RigidBody>& body, const Load& load) {
  if (!(load.mass > 0)) return;
  const RigidBody more{load.mass, load.p_FC, load.inertia_C};
  body = body ? merged(*body, more) : more;
}

}  // namespace

Mounting mounting_of(const MeasuredLog& log) {
  Mounting out;
  if (log.scene_text.empty()) return out;
  const Scene scene = rebuild_scene(log.scene_text, log.scene_path);
  for (const SceneArm& arm : scene.arms) {
    if (arm.name != log.arm && !(log.arm.empty() && scene.arms.size() == 1)) continue;
    out.told = true;
    out.hand = arm.hand;
    add(out.tool_without_load, arm.tool);
    out.tool = out.tool_without_load;
    add(out.tool, arm.load_declared);
    out.gravity_B = arm.X_WB.rotation.transpose() * Vector3(0, 0, -9.81);
    return out;
  }
  throw std::invalid_argument(log.source + ": its scene has no arm '" + log.arm + "'");
}

}  // namespace multipanda
