#pragma once

#include <memory>
#include <string_view>

#include "core/controllets/controllet.hpp"
#include "core/geometry/obstacle.hpp"
#include "core/types/arm_set.hpp"

namespace multipanda {

// Something that adds torque to whatever controllet owns the arms: collision avoidance, joint-limit
// repulsion, ... One object per controllet instance and feature, built before the loop, switched on and off
// at cycle boundaries. Same rules and thread as a Controllet; its context has its own parameters and outputs
// and no inputs, and arms[i].tau holds what the features before it added: add to it.
class Feature {
 public:
  virtual ~Feature() = default;
  // Why start() refuses whatever the state is, in words for people; empty: nothing speaks against it. Known
  // since the feature was built; any thread.
  virtual std::string_view refusal() const { return {}; }
  virtual LawResult start(ControlContext& context) = 0;   // in the cycle it is switched on
  virtual LawResult update(ControlContext& context) = 0;  // arms[i].tau += ...
};

// What a feature's factory gets: where it will live. Valid during the call; copy what you keep.
struct Surroundings {
  ArmModels arms;                       // of the whole scene
  std::span<const ArmIndex> own;        // which of them context.arms are, in that order
  std::span<const Obstacle> obstacles;  // what stands fixed in the world
  ArmSet friction_compensated;          // arms whose backend compensates joint friction itself
};

struct FeatureType {
  Statement statement;  // `arms` is ignored: a feature serves any number
  std::unique_ptr<Feature> (*create)(const Surroundings& surroundings) = nullptr;
};

}  // namespace multipanda
