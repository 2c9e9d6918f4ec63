#include "cockpit/view/near_pairs.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace multipanda::cockpit {

NearPairs::NearPairs(std::vector<std::shared_ptr<const ArmModel>> models, std::vector<Obstacle> obstacles)
    : models_(std::move(models)), obstacles_(std::move(obstacles)), all_(models_.size()) {
  std::iota(all_.begin(), all_.end(), ArmIndex{0});
  pairs_ = std::make_unique<CollisionPairs>(
      FeatureContext{.arms = models_, .own = all_, .obstacles = obstacles_, .friction_compensated = {}});
}

void NearPairs::find(std::span<ModelTerms> terms, std::span<double> out) {
  std::ranges::fill(out, std::numeric_limits<double>::quiet_NaN());
  std::vector<OwnedArm> arms(terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) arms[i].terms = &terms[i];
  pairs_->place(arms);
  struct Found {
    double distance;
    std::size_t pair;
    Closest closest;
  };
  std::vector<Found> found;
  for (std::size_t i = 0; i < pairs_->size(); ++i) {
    if (!(pairs_->at_least(i) < kNear)) continue;
    const Closest closest = pairs_->closest(i);
    if (closest.distance < kNear) found.push_back({closest.distance, i, closest});
  }
  std::ranges::sort(found, {}, &Found::distance);
  double* at = out.data();
  for (std::size_t k = 0; k < std::min(found.size(), kMost); ++k) {
    const auto& [distance, index, closest] = found[k];
    const auto arm_of = [&](std::uint16_t body) {
      const ArmIndex arm = pairs_->body(body).arm;
      return arm == CollisionPairs::kNoArm ? -1.0 : static_cast<double>(arm);
    };
    const auto& pair = pairs_->pair(index);
    const Vector3 &a = closest.p_A, &b = closest.p_B;
    for (const double value :
         {distance, a.x(), a.y(), a.z(), b.x(), b.y(), b.z(), arm_of(pair.a), arm_of(pair.b)})
      *at++ = value;
  }
}

}  // namespace multipanda::cockpit
