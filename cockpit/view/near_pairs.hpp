#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/features/collision_pairs.hpp"

namespace multipanda::cockpit {

// Pairs of parts that are close: arms, or an arm and a fixed object of the scene.
class NearPairs {
 public:
  static constexpr double kNear = 0.05;  // [m]
  static constexpr std::size_t kMost = 16;
  static constexpr std::size_t kNumbers = 9;  // distance, from (3), to (3), arm of each (-1: an object)

  // `obstacles` are copied.
  NearPairs(std::vector<std::shared_ptr<const ArmModel>> models, std::vector<Obstacle> obstacles);

  // The closest kMost pairs, sorted; the rest of `out` (kMost * kNumbers) is not a number. `terms`: one per
  // arm, updated.
  void find(std::span<ModelTerms> terms, std::span<double> out);

 private:
  std::vector<std::shared_ptr<const ArmModel>> models_;
  std::vector<Obstacle> obstacles_;
  std::vector<ArmIndex> all_;
  std::unique_ptr<CollisionPairs> pairs_;
};

}  // namespace multipanda::cockpit
