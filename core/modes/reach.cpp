#include "core/modes/reach.hpp"

#include <array>
#include <cstdio>
#include <limits>

namespace multipanda {

Reach::Reach(const ArmBlocks& blocks) {
  for (std::size_t a = 0; a < blocks.terms.size(); ++a) {
    const ArmModel& model = blocks.terms[a].model();
    ModelTerms terms(blocks.terms[a].shared_model());
    terms.update(model.q_home(), JointVector::Zero(model.q_home().size()));
    const std::size_t n = model.joint_count();
    Arm& arm = arms_.emplace_back();
    arm.name = model.name();
    arm.first_joint = terms.X_WJ(0).position;
    arm.last_joint = terms.X_WJ(n - 1).position;
    for (std::size_t i = 1; i < n; ++i)
      arm.between += (terms.X_WJ(i).position - terms.X_WJ(i - 1).position).norm();
    arm.X_WF = terms.X_WE();  // no end effector is configured
    arm.moves = a < blocks.mounts.size() && blocks.mounts[a].has_value();
    arm.length = std::numeric_limits<double>::infinity();
  }
}

void Reach::set_end_effector(ArmIndex index, const Pose& X_FE) {
  Arm& arm = arms_[index];
  if (arm.moves) return;
  arm.length.store(arm.between + (arm.X_WF * X_FE.position - arm.last_joint).norm(),
                   std::memory_order_relaxed);
}

bool Reach::contains(const Instance& instance, const InputSpec& input, std::span<const double> values,
                     std::string* why) const {
  if (input.quantity != Quantity::pose || input.frame != "world") return true;
  const Vector3 p_W(values[0], values[1], values[2]);
  const auto& indices = instance.arm_list();
  const Arm& own = arms_[indices[input.arm]];
  const double length = own.length.load(std::memory_order_relaxed), distance = (p_W - own.first_joint).norm();
  if (distance <= length) return true;
  // Each hand is within its arm's length of its arm's first joint, so the middle of the hands is within the
  // mean of the lengths of the middle of the joints.
  Vector3 middle = Vector3::Zero();
  double lengths = 0;
  for (const ArmIndex i : indices) {
    middle += arms_[i].first_joint;
    lengths += arms_[i].length.load(std::memory_order_relaxed);
  }
  const auto count = static_cast<double>(indices.size());
  const double from_middle = (p_W - middle / count).norm(), reach = lengths / count;
  if (indices.size() > 1 && from_middle <= reach) return true;
  if (why == nullptr) return false;
  std::array<char, 320> text{};
  std::snprintf(text.data(), text.size(),
                "out of reach: %.3f m from the first joint of arm '%s', whose end effector reaches %.3f m at "
                "most",
                distance, own.name.c_str(), length);
  *why = text.data();
  if (indices.size() > 1) {
    std::snprintf(text.data(), text.size(),
                  ", and %.3f m from the middle of the arms' first joints, where the middle of the hands "
                  "reaches %.3f m at most",
                  from_middle, reach);
    *why += text.data();
  }
  if (distance > 10 * length) *why += " (this looks like millimeters)";
  return false;
}

}  // namespace multipanda
