#pragma once

#include <memory>
#include <string_view>
#include <type_traits>

#include "core/controllets/controllet.hpp"
#include "core/geometry/shape.hpp"
#include "core/types/arm_set.hpp"

namespace multipanda {

// Adds torque to the controllet that owns the arms: collision avoidance, joint-limit repulsion, ... There is
// one object per controllet instance and feature, built before the loop and switched on and off at cycle
// boundaries. Rules and thread are those of a Controllet. Its context has its own parameters and outputs and
// no inputs. arms[i].tau holds the torque of the features before it: add to it.
class Feature {
 public:
  virtual ~Feature() = default;
  // Human-readable reason why start() refuses in any state; empty if it does not. Fixed by the constructor;
  // any thread.
  virtual std::string_view refusal() const { return {}; }
  // What start() requires of the measured state, as text; a refused start may name the violation. Whether it
  // is empty is fixed by the constructor: if it is, start() accepts every state, and a hold may have the
  // feature. Any thread.
  virtual std::string_view start_condition() const { return {}; }
  virtual LawResult start(ControlContext& context) = 0;   // in the cycle it is switched on
  virtual LawResult update(ControlContext& context) = 0;  // arms[i].tau += ...
  // Lowers upper bounds of parameters to the limits of these arms. Before the loop, once.
  virtual void bound_parameters(ParameterSet& /*parameters*/) const {}
};

// Argument of a feature's factory. Except for the obstacles, it is valid during the call only; the feature
// must copy what it keeps.
struct FeatureContext {
  ArmModels arms;                 // of the whole scene
  std::span<const ArmIndex> own;  // indices of context.arms, in that order
  // Fixed objects in the world. They outlive the feature; in every cycle their poses are those of now.
  std::span<const Obstacle> obstacles;
  ArmSet friction_compensated;  // arms whose backend has no joint friction or compensates it
};

struct FeatureType {
  ControlletDescriptor descriptor;  // `arms` is ignored: a feature serves any number
  std::unique_ptr<Feature> (*create)(const FeatureContext& context) = nullptr;
};

// The type of a class with a static descriptor(). Its constructor takes the FeatureContext, or nothing.
template <typename Law>
FeatureType feature_type() {
  return {Law::descriptor(), [](const FeatureContext& context) -> std::unique_ptr<Feature> {
            if constexpr (std::is_constructible_v<Law, const FeatureContext&>) {
              return std::make_unique<Law>(context);
            } else {
              return std::make_unique<Law>();
            }
          }};
}

}  // namespace multipanda
