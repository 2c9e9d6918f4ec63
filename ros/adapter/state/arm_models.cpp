#include "ros/adapter/state/arm_models.hpp"

#include "logs/event_text.hpp"
#include "models/write_robot.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "scene/build.hpp"

namespace multipanda::ros {

ArmModels::ArmModels(const RunContext& run) {
  for (std::size_t i = 0; i < run.scene->arms.size(); ++i) {
    const SceneArm& from = run.scene->arms[i];
    const ArmConfig config = arm_config(from);
    Arm arm{.name = from.name, .prefix = from.name + "_", .robot = robot_of(from), .hand = from.hand};
    arm.joint_count = run.models[i]->joint_count();
    arm.joint_names = joint_names(from.name, arm.joint_count);
    arm.frames = config.frames;
    arm.tool = config.tool;
    arm.load = config.load;
    arms_.push_back(std::move(arm));
    terms_.emplace_back(run.models[i]);
    terms_.back().set_config(config.frames, config.tool, config.load);
  }
  current_.resize(arms_.size());
}

void ArmModels::take(const Event& event) {
  if (event.arm >= arms_.size()) return;
  Arm& arm = arms_[event.arm];
  if (!read_arm_config(event, arm.frames, arm.tool, arm.load)) return;
  arm.config_version = event.index;
  terms_[event.arm].set_config(arm.frames, arm.tool, arm.load);
  current_[event.arm] = false;
}

void ArmModels::take(const CycleRecord& record) {
  record_ = &record;
  current_.assign(current_.size(), false);
}

ModelTerms& ArmModels::terms(std::size_t arm) {
  if (!current_[arm]) {
    const auto n = static_cast<Eigen::Index>(arms_[arm].joint_count);
    const ArmSample& sample = record_->arms[arm];
    terms_[arm].update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), n)),
                       JointVector(Eigen::Map<const Eigen::VectorXd>(sample.dq.data(), n)));
    current_[arm] = true;
  }
  return terms_[arm];
}

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
