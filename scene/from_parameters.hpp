#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "scene/scene.hpp"

// A scene from flat parameters, such as those of ROS 2: "controllets.left_pose.type",
// "arms.left.base.position_m". Dots stand for nesting; lists of mappings become mappings by name, as in
// scene files.
namespace multipanda {

using ParameterValue = std::variant<bool, std::int64_t, double, std::string, std::vector<bool>,
                                    std::vector<std::int64_t>, std::vector<double>, std::vector<std::string>>;
using FlatParameters = std::vector<std::pair<std::string, ParameterValue>>;

// Properties of an arm that the host of a control cycle needs in addition to the scene; also under
// `arms.<name>`.
struct HostedArm {
  enum class Gravity : std::uint8_t {
    unspecified,  // the hardware must report it; refused otherwise
    robot,        // the arm compensates it: torques exclude gravity
    cycle         // the cycle adds it to the torques
  };
  std::string name;
  std::vector<std::string> joints;         // names in the interfaces; empty: <name>_joint1, ...
  Gravity gravity = Gravity::unspecified;  // key `gravity_compensation`: robot, controller
  bool forces_by_robot = false;            // key `external_forces`: observer (default), robot
  // Key `state_interfaces`, a list: position and velocity always, these by default.
  bool has_effort = true, has_robot_state = true;
  std::string base_link, tip_link;  // of the robot description, with `model: robot_description`
};

struct ParameterScene {
  std::string yaml;             // for parse_scene
  std::vector<HostedArm> arms;  // in the scene's order
  std::vector<std::string> plugins;
};

// `arm_names` (a list of strings) gives the order of the arms, which is otherwise alphabetical. Parameters
// that do not belong to a scene are ignored unless they look like a mistyped one. `model_of` gives the path
// of the model of an arm with `model: robot_description`. Throws std::invalid_argument: parameter, what was
// expected, the nearest valid name.
ParameterScene scene_from_parameters(const FlatParameters& parameters,
                                     const std::function<std::string(const HostedArm&)>& model_of = {});

}  // namespace multipanda
