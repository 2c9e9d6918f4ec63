#pragma once

#include <map>
#include <string>

#include "scene/from_parameters.hpp"

namespace multipanda {

// The parameters of a hardware component, which URDFs carry as texts, as a scene.
//
//   scene             a scene file or name: everything comes from there; nothing else of a scene may be said
//   arm_names         "left right" (or with commas)
//   arms.<name>.*     the scene's keys of an arm, values in YAML: "[0, 0.26, 0]"
//   objects.<name>.*  of an object
//   arms.<name>.fci   address, with `real` required
// Names that users of multipanda_ros2 know are understood too: robot_count, ns_<i>, robot_ip_<i>, hand_<i>.
//
// `real`: every arm needs an address; else addresses are refused. Other keys are left alone if `others` names
// them, and refused otherwise. Throws std::invalid_argument.
Scene hardware_scene(const std::map<std::string, std::string>& parameters, bool real,
                     const std::vector<std::string>& others = {});

}  // namespace multipanda
