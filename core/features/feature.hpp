#pragma once

#include <memory>

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Something that adds torque to whatever controllet owns the arms: collision avoidance, joint-limit
// repulsion, ... One object per controllet instance and feature, built before the loop, switched on and off
// at cycle boundaries. Same rules and thread as a Controllet; its context has its own parameters and outputs
// and no inputs, and arms[i].tau holds what the features before it added: add to it.
class Feature {
 public:
  virtual ~Feature() = default;
  virtual LawResult start(ControlContext& context) = 0;   // in the cycle it is switched on
  virtual LawResult update(ControlContext& context) = 0;  // arms[i].tau += ...
};

struct FeatureType {
  Statement statement;  // `arms` is ignored: a feature serves any number
  std::unique_ptr<Feature> (*create)(ArmModels arms) = nullptr;
};

}  // namespace multipanda
