#include "core/model/base_mount.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

#include "core/model/model_terms.hpp"

namespace multipanda {

// A revolute axis that leans by phi moves everything behind it around a cone, which changes its lean by at
// most 2 phi.
std::string turns_against_gravity(const ArmModel& carrier, std::size_t joint) {
  ModelTerms terms(std::shared_ptr<const ArmModel>(std::shared_ptr<void>(), &carrier));
  terms.update(carrier.q_home(), JointVector::Zero(carrier.q_home().size()));
  const Jacobian& J = terms.J_V_WE();
  double swing = 0;
  for (std::size_t i = 0; i <= joint && i < carrier.joint_count(); ++i) {
    const auto column = J.col(static_cast<Eigen::Index>(i));
    const bool slides = carrier.is_prismatic(i);
    const double lean = slides ? std::abs(column[2]) : column.tail<3>().head<2>().norm();
    const double most = std::min(1.0, lean + swing);
    if (!slides) swing += 2 * lean;
    if (most <= kUpright) continue;
    constexpr double kDegrees = 180 / std::numbers::pi;
    std::array<char, 400> text;
    std::snprintf(
        text.data(), text.size(),
        "the axis of joint%zu of '%s' can be %.3g degrees from %s; expected at most %.2g, since neither arm "
        "compensates the weight that this joint would turn: mount it upright, or let the model hold this "
        "joint (held_joints)",
        i + 1, carrier.name().c_str(), kDegrees * std::asin(most), slides ? "level" : "vertical",
        kDegrees * std::asin(kUpright));
    return text.data();
  }
  return {};
}

}  // namespace multipanda
