#include "cockpit/view/scene_text.hpp"

#include "cockpit/view/json_numbers.hpp"
#include "scene/build.hpp"

namespace multipanda::cockpit {

using nlohmann::json;

json describe_arms(const Scene& scene) {
  json arms = json::array();
  for (const SceneArm& arm : scene.arms) {
    const RobotDescription robot = robot_of(arm);
    const ArmLimits& limits = arm.safety.joints;
    const Pose X_FE = arm_config(arm).frames.X_FE;
    json entry = {{"name", arm.name},
                  {"model", robot.name},
                  {"title", robot.title},
                  {"joints", robot.joint_count()},
                  {"base_position_m", numbers(arm.X_WB.position)},
                  {"base_quaternion_wxyz", numbers(arm.X_WB.quaternion())},
                  {"q_min_rad", numbers(limits.q_min)},
                  {"q_max_rad", numbers(limits.q_max)},
                  {"dq_max_rad_per_s", numbers(limits.dq_max)},
                  {"tau_max_nm", numbers(limits.tau_max)},
                  {"q_home_rad", numbers(robot.q_home)},
                  {"end_effector",
                   {{"position_m", numbers(X_FE.position)}, {"quaternion_wxyz", numbers(X_FE.quaternion())}}},
                  {"workspace", nullptr}};
    if (const auto& box = arm.safety.workspace)
      entry["workspace"] = {{"min_m", numbers(box->min)}, {"max_m", numbers(box->max)}};
    arms.push_back(std::move(entry));
  }
  return arms;
}

}  // namespace multipanda::cockpit
