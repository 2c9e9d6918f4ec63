#include "sysid/measured/scene_model.hpp"

#include <stdexcept>

#include "core/model/model_terms.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda {

Scene rebuild_scene(const std::string& text, const std::string& path) {
  if (text.empty()) throw std::runtime_error("the scene file is not in the log");
  const std::string name = path.empty() ? "scene.yaml" : path;
  const Registry registry = build_registry(scene_plugins(text, name));
  Scene scene = parse_scene(text, name, registry);
  refuse_carried_arms(scene, "the analysis of a log");
  return scene;
}

void complete_from_model(MeasuredLog& log, std::shared_ptr<const ArmModel> model,
                         const std::vector<ConfigFrom>& configs) {
  const bool pose = log.x_EE.rows() == 0, gravity = log.gravity.rows() == 0;
  if (!pose && !gravity) return;
  const Eigen::Index N = log.samples(), n = log.joints();
  if (pose) log.x_EE.resize(N, 3), log.quat_EE.resize(N, 4);
  if (gravity) log.gravity.resize(N, n);
  ModelTerms terms(std::move(model));
  const JointVector still = JointVector::Zero(n);
  std::size_t next = 0;
  for (Eigen::Index k = 0; k < N; ++k) {
    for (; next < configs.size() && configs[next].sample <= k; ++next)
      terms.set_config(configs[next].frames, configs[next].tool, configs[next].load);
    terms.update(JointVector(log.q.row(k).transpose()), still);
    if (pose) {
      const Pose& X_WE = terms.X_WE();
      log.x_EE.row(k) = X_WE.position.transpose();
      const Quaternion q = X_WE.quaternion();
      log.quat_EE.row(k) << q.w(), q.x(), q.y(), q.z();
    }
    if (gravity) log.gravity.row(k) = terms.g().transpose();
  }
}

void complete_from_scene(MeasuredLog& log, const std::string& scene_text, const std::string& scene_path,
                         const std::string& arm) {
  const Scene scene = rebuild_scene(scene_text, scene_path);
  std::string names;
  const SceneArm* found = nullptr;
  for (const SceneArm& candidate : scene.arms) {
    names += (names.empty() ? "" : ", ") + candidate.name;
    if (candidate.name == arm || (arm.empty() && scene.arms.size() == 1)) found = &candidate;
  }
  if (found == nullptr) {
    throw std::invalid_argument(arm.empty() ? "the scene has several arms; name one of " + names
                                            : "the scene has no arm '" + arm + "'; expected one of " + names);
  }
  const auto model = build_arm_model(*found);
  if (static_cast<Eigen::Index>(model->joint_count()) != log.joints()) {
    throw std::invalid_argument(log.source + " has " + std::to_string(log.joints()) +
                                " joints, the scene's arm '" + found->name + "' (" + found->model + ") has " +
                                std::to_string(model->joint_count()));
  }
  const ArmConfig config = arm_config(*found);
  complete_from_model(log, model, {{0, config.frames, config.tool, config.load}});
}

}  // namespace multipanda
