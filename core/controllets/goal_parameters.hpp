#pragma once

#include "core/controllets/parameters.hpp"

namespace multipanda {

// Whether a change of this parameter may move an arm, as a goal does. It is derived from the unit, so that no
// new law can forget to declare it. Stiffness, damping, gains (all per something), frequencies, times and
// energies change how an arm responds; everything else counts as a goal: lengths, angles, speeds, forces,
// masses, choices, switches, pure numbers.
inline bool acts_as_goal(const ParameterSpec& spec) {
  if (spec.name == "damping_ratio") return false;  // the pure number that is a gain in every law
  if (spec.unit == "m/s" || spec.unit == "rad/s") return true;
  return spec.unit.find('/') == std::string::npos && spec.unit != "Hz" && spec.unit != "s" &&
         spec.unit != "J";
}

// Whether a larger value pulls an arm to a waiting set-point.
inline bool is_stiffness(const ParameterSpec& spec) { return spec.unit == "N/m" || spec.unit == "N m/rad"; }

}  // namespace multipanda
