#include "fci/server/from_scene.hpp"

#include "device/declared_hand.hpp"
#include "fci/model/model_urdf.hpp"
#include "scene/build.hpp"

namespace multipanda::fci {
namespace {

// Hand and tool as a real arm's settings name them: its hand by the manufacturer's rounded figures.
RigidBody declared_end_effector(const RobotDescription& robot, const SceneArm& arm) {
  if (!arm.hand) return end_effector(robot, false, arm.tool);
  const RigidBody hand = end_effector(robot, true, {});
  const Load declared = declared_hand({hand.mass, hand.com, hand.inertia});
  const RigidBody body{declared.mass, declared.p_FC, declared.inertia_C};
  return arm.tool.mass > 0 ? merged(body, {arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C}) : body;
}

}  // namespace

FixedConfig fixed_config(const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  FixedConfig config{.X_FNE = {},
                     .ee = declared_end_effector(robot, arm),
                     .gravity_B = arm.X_WB.rotation.transpose() * Vector3(0, 0, -9.81)};
  if (arm.hand) config.X_FNE = robot.hand->mount.pose() * robot.hand->tcp.pose();
  return config;
}

}  // namespace multipanda::fci
