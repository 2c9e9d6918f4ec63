#pragma once

#include <string>

#include "core/controllets/builtins.hpp"
#include "core/features/builtins.hpp"
#include "scene/load.hpp"

namespace multipanda {

// A type with every kind of input and parameter that the built-in ones do not have together.
inline ControlletType test_type(const std::string& name, std::size_t arms, std::size_t observes = 0) {
  return {{.type = name,
           .doc = "For tests.",
           .arms = arms,
           .observes = observes,
           .inputs = {{.name = "pose", .quantity = Quantity::pose},
                      {.name = "joints", .quantity = Quantity::joints},
                      {.name = "wrench", .quantity = Quantity::wrench},
                      {.name = "twist", .quantity = Quantity::twist},
                      {.name = "gain", .quantity = Quantity::scalar}},
           .parameters = {{"stiffness_n_per_m", "N/m", 3, {400}, 0, 5000, ""},
                          {"angle_rad", "rad", 1, {0}, -3, 3, ""},
                          {"axes", "", 1, {0}, 0, 1, "", {"world", "tool"}},
                          switch_parameter("feedforward", true, "")}},
          hold_controllet().create};
}

inline const Registry& registry() {
  static const Registry types = [] {
    Registry r;
    r.add(hold_controllet());
    r.add(gravity_compensation_controllet());
    r.add(joint_limits_feature());
    r.add(test_type("solo", 1));
    r.add(test_type("duo", 2));
    r.add(test_type("watcher", 1, 1));
    return r;
  }();
  return types;
}

inline Scene parse(const std::string& text) { return parse_scene(text, "s.yaml", registry()); }

}  // namespace multipanda
