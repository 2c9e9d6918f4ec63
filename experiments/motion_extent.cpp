#include "experiments/motion_extent.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "scene/build.hpp"

namespace multipanda {

MotionExtent::MotionExtent(const Scene& scene, const std::vector<std::shared_ptr<const ArmModel>>& models) {
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    Arm arm{.name = scene.arms[i].name, .X_BW = scene.arms[i].X_WB.inverse(), .terms = ModelTerms(models[i])};
    const ArmConfig config = arm_config(scene.arms[i]);
    arm.terms.set_config(config.frames, config.tool, config.load);
    arms_.push_back(std::move(arm));
  }
}

void MotionExtent::take(const CycleRecord& record) {
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    const ArmSample& sample = record.arms[i];
    if (sample.sequence == 0) continue;
    if (sample.has_contact_truth)
      arm.force = std::max(arm.force, Eigen::Map<const Vector3>(sample.F_K_W_true.data()).norm());
    const auto n = arm.terms.model().joint_count();
    if (!arm.begun) arm.q0 = sample.q;
    for (std::size_t j = 0; j < n; ++j) {
      arm.joint_speed = std::max(arm.joint_speed, std::abs(sample.dq[j]));
      const double angle = std::abs(sample.q[j] - arm.q0[j]);
      if (angle > arm.angle) {
        arm.angle = angle;
        arm.joint = j;
      }
    }
    if (arm.begun && record.cycle % kEvery != 0) continue;
    const auto size = static_cast<Eigen::Index>(n);
    arm.terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), size)),
                     JointVector(Eigen::Map<const Eigen::VectorXd>(sample.dq.data(), size)));
    const Vector3 p_BE = (arm.X_BW * arm.terms.X_WE()).position;
    if (!arm.begun) {
      arm.p0 = p_BE;
      arm.lowest = arm.highest = p_BE.z();
      arm.begun = true;
    }
    arm.hand = std::max(arm.hand, (p_BE - arm.p0).norm());
    arm.hand_speed = std::max(arm.hand_speed, arm.terms.V_WE().linear().norm());
    arm.lowest = std::min(arm.lowest, p_BE.z());
    arm.highest = std::max(arm.highest, p_BE.z());
  }
}

nlohmann::ordered_json MotionExtent::json() const {
  auto list = nlohmann::ordered_json::array();
  for (const auto& arm : arms_) {
    list.push_back({{"arm", arm.name},
                    {"hand_m", arm.hand},
                    {"hand_m_per_s", arm.hand_speed},
                    {"joint", arm.joint + 1},
                    {"joint_rad", arm.angle},
                    {"joint_rad_per_s", arm.joint_speed},
                    {"force_n", arm.force},
                    {"lowest_m", arm.lowest},
                    {"highest_m", arm.highest}});
  }
  return list;
}

std::string MotionExtent::beyond(const nlohmann::ordered_json& expected) const {
  for (std::size_t i = 0; i < arms_.size() && i < expected.size(); ++i) {
    const Arm& arm = arms_[i];
    if (!arm.begun) continue;
    const auto more = [&](const char* what, double value, const char* key, double margin, const char* unit) {
      const double bound = expected[i].at(key).get<double>() + margin;
      return (margin > 0 ? value > bound : value < bound)
                 ? fmt::format("{} of arm '{}' {} {:.2f} {}, in simulation {:.2f} {}",
                               std::string(key).starts_with("joint") ? "a joint" : "the hand", arm.name, what,
                               value, unit, bound - margin, unit)
                 : std::string();
    };
    for (const std::string& text :
         {more("went", arm.hand, "hand_m", kFarther, "m"),
          more("moved at", arm.hand_speed, "hand_m_per_s", kFaster, "m/s"),
          more("sank to a height of", arm.lowest, "lowest_m", -kFarther, "m"),
          more("rose to a height of", arm.highest, "highest_m", kFarther, "m"),
          more("turned by", arm.angle, "joint_rad", kTurnedMore, "rad"),
          more("turned at", arm.joint_speed, "joint_rad_per_s", kTurnedFaster, "rad/s")}) {
      if (!text.empty()) return text;
    }
  }
  return {};
}

std::string describe_extent(const nlohmann::ordered_json& extent) {
  std::string text;
  for (const auto& arm : extent) {
    const auto number = [&arm](const char* key) { return arm.at(key).get<double>(); };
    text += fmt::format(
        "  arm '{}': hand up to {:.2f} m from its start, at up to {:.2f} m/s, {:.2f} to {:.2f} m above its "
        "base; "
        "joint {} by {:.2f} rad, joints at up to {:.2f} rad/s",
        arm.at("arm").get<std::string>(), number("hand_m"), number("hand_m_per_s"), number("lowest_m"),
        number("highest_m"), arm.at("joint").get<int>(), number("joint_rad"), number("joint_rad_per_s"));
    if (number("force_n") > 0) text += fmt::format("; presses with up to {:.0f} N", number("force_n"));
    text += '\n';
  }
  if (!text.empty()) text.pop_back();
  return text;
}

}  // namespace multipanda
