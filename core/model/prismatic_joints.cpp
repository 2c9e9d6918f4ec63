#include "core/model/prismatic_joints.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "core/model/model_terms.hpp"

namespace multipanda {
namespace {

constexpr double kGravity = 9.81;     // [m/s^2]
constexpr double kMostPayload = 100;  // [kg], that a request may declare if the model does not say

// The sine of the steepest slope that each prismatic axis can take. At home it is that of its column of the
// Jacobian. A revolute joint whose axis leans by phi from the vertical leads the vertical direction around a
// cone, so it changes the sine by at most the diameter of that cone, 2 sin(phi). (n x 1), 0: revolute.
JointVector steepest_slopes(const ArmModel& model, const Jacobian& J) {
  JointVector slopes = JointVector::Zero(J.cols());
  double swing = 0;
  for (Eigen::Index k = 0; k < J.cols(); ++k) {
    if (model.is_prismatic(static_cast<std::size_t>(k))) {
      slopes[k] = std::min(1.0, std::abs(J(2, k)) + swing);
    } else {
      swing += 2 * J.col(k).tail<3>().head<2>().norm();
    }
  }
  return slopes;
}

}  // namespace

std::string weight_on_an_axis(const ArmModel& model, const JointVector& tau_max) {
  if (!has_prismatic_joints(model)) return {};
  ModelTerms terms(std::shared_ptr<const ArmModel>(std::shared_ptr<void>(), &model));
  terms.set_config({}, model.tool(), {});
  terms.update(model.q_home(), JointVector::Zero(model.q_home().size()));
  JointMatrix M = terms.M();
  if (model.known_motor_inertia().size() == M.rows()) M.diagonal() -= model.known_motor_inertia();
  const JointVector slopes = steepest_slopes(model, terms.J_V_WE());
  for (Eigen::Index k = 0; k < slopes.size(); ++k) {
    if (!model.is_prismatic(static_cast<std::size_t>(k))) continue;
    const double mass = M(k, k) + model.largest_load().value_or(kMostPayload);
    const double weight = kGravity * mass * slopes[k],
                 force = std::min(tau_max[k], model.limits().tau_max[k]);
    const double most = std::min(kWeightShare * force, kMostWeight);
    if (slopes[k] <= kLevel && weight <= most) continue;
    constexpr double kDegrees = 180 / std::numbers::pi;
    std::array<char, 640> text;
    std::snprintf(
        text.data(), text.size(),
        "the prismatic joint%zu of arm '%s' would bear weight: its axis can be %.3g degrees from level, and "
        "%.4g kg press along it with %.4g N of its %.4g N; expected at most %.2g degrees and %.3g N. "
        "Without commands, or with a payload that is declared wrong, it would fall: mount the axis level, "
        "or let the model file hold this joint (held_joints) and move it, with a brake that closes without "
        "commands, only while no controllet of this arm is active",
        static_cast<std::size_t>(k) + 1, model.name().c_str(), kDegrees * std::asin(slopes[k]), mass, weight,
        force, kDegrees * std::asin(kLevel), most);
    return text.data();
  }
  return {};
}

}  // namespace multipanda
