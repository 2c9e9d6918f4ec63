#include "core/types/joint_range.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace multipanda {

std::size_t JointRange::first_outside(std::span<const double> q) const {
  for (std::size_t i = 0; i < q.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    if (!(q[i] >= min[k] - kRounding && q[i] <= max[k] + kRounding)) return i;
  }
  return q.size();
}

std::string JointRange::refusal(std::span<const double> q) const {
  const std::size_t i = first_outside(q);
  if (i == q.size()) return {};
  const auto k = static_cast<Eigen::Index>(i);
  const bool slides = (prismatic >> i & 1u) != 0;
  const char* const unit = slides ? "m" : "rad";
  // The value would fit in thousandths, or converted to radians; a joint hardly turns more than once.
  constexpr double kDegree = std::numbers::pi / 180, kTurn = 2 * std::numbers::pi;
  const auto inside = [&](double x) { return x >= min[k] && x <= max[k]; };
  const bool far = std::abs(q[i]) > 10 * std::max(std::abs(min[k]), std::abs(max[k]));
  const char* const hint = slides && far && inside(q[i] / 1000) ? " (this looks like millimeters)"
                           : !slides && std::abs(q[i]) > kTurn && inside(kDegree * q[i])
                               ? " (this looks like degrees)"
                               : "";
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "joint%zu: %.6g %s is outside of %.6g to %.6g %s%s", i + 1, q[i],
                unit, min[k], max[k], unit, hint);
  return text.data();
}

}  // namespace multipanda
