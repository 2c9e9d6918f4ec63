#include "core/model/prismatic_joints.hpp"

#include <array>
#include <cmath>
#include <cstdio>

#include "core/model/model_terms.hpp"

namespace multipanda {

std::string too_heavy_for_an_axis(const ArmModel& model, double mass) {
  if (!(mass > 0) || !has_prismatic_joints(model)) return {};
  constexpr double kGravity = 9.81;
  ModelTerms terms(std::shared_ptr<const ArmModel>(std::shared_ptr<void>(), &model));
  terms.set_config({}, model.tool(), {});
  terms.update(model.q_home(), JointVector::Zero(model.q_home().size()));
  JointMatrix M = terms.M();
  if (model.known_motor_inertia().size() == M.rows()) M.diagonal() -= model.known_motor_inertia();
  bool turns = false;
  for (std::size_t i = 0; i < model.joint_count(); ++i) {
    turns = turns || !model.is_prismatic(i);
    if (!model.is_prismatic(i)) continue;
    const auto k = static_cast<Eigen::Index>(i);
    const double vertical = turns ? 1 : std::abs(terms.J_V_WE()(2, k)), own = M(k, k);
    const double weight = kGravity * (own + mass) * vertical, most = model.limits().tau_max[k];
    if (weight <= most) continue;
    std::array<char, 320> text;
    std::snprintf(
        text.data(), text.size(),
        "a payload of %.4g kg beside the %.4g kg of the arm weighs %.4g N along the prismatic joint%zu "
        "of arm '%s', which can carry %.4g N: mount its axis less steeply, or declare less",
        mass, own, weight, i + 1, model.name().c_str(), most);
    return text.data();
  }
  return {};
}

}  // namespace multipanda
