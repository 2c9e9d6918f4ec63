#pragma once

#include <map>
#include <string>

#include "scene/from_parameters.hpp"

namespace multipanda {

// Returns a scene from the parameters of a hardware component, which URDFs carry as strings.
//
//   scene             a scene file or name; then no other parameter of a scene is allowed
//   arm_names         "left right" (or with commas)
//   arms.<name>.*     the scene's keys of an arm, with values in YAML: "[0, 0.26, 0]"
//   objects.<name>.*  those of an object
//   arms.<name>.fci   address; required with `real`
// The names of multipanda_ros2 are accepted too: robot_count, ns_<i>, robot_ip_<i>, hand_<i>.
//
// `real`: every arm needs an address; otherwise addresses are refused. Keys in `others` are ignored, all
// other keys are refused. Throws std::invalid_argument.
Scene hardware_scene(const std::map<std::string, std::string>& parameters, bool real,
                     const std::vector<std::string>& others = {});

}  // namespace multipanda
