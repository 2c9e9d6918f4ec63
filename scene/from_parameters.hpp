#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "scene/scene.hpp"

// A scene said by flat parameters, as those of ROS 2: "controllets.left_pose.type",
// "arms.left.base.position_m". A parameter's dots are the scene's nesting; lists of mappings stand by name,
// as scene files may write them too.
namespace multipanda {

using ParameterValue = std::variant<bool, std::int64_t, double, std::string, std::vector<bool>,
                                    std::vector<std::int64_t>, std::vector<double>, std::vector<std::string>>;
using FlatParameters = std::vector<std::pair<std::string, ParameterValue>>;

// What whoever hosts a control cycle has to know of an arm beyond the scene's own keys; stands among them,
// under `arms.<name>`.
struct HostedArm {
  enum class Gravity : std::uint8_t {
    unsaid,  // the hardware has to say; refused if it does not
    robot,   // holds itself against gravity: torques exclude it
    cycle    // the cycle adds it to its torques
  };
  std::string name;
  std::vector<std::string> joints;    // their names in the interfaces; empty: <name>_joint1, ...
  Gravity gravity = Gravity::unsaid;  // key `gravity_compensation`: robot, controller
  bool forces_by_robot = false;       // key `external_forces`: observer (default), robot
  // Key `state_interfaces`, a list: position and velocity always, these by default.
  bool has_effort = true, has_robot_state = true;
  std::string base_link, tip_link;  // of the robot description, with `model: robot_description`
};

struct ParameterScene {
  std::string yaml;             // for parse_scene
  std::vector<HostedArm> arms;  // in the scene's order
  std::vector<std::string> plugins;
};

// `arm_names` (a list of texts) gives the arms' order, which else is alphabetical. Parameters that belong to
// no scene are left alone, unless they look like a mistyped one. `model_of` gives the model of an arm that
// says `model: robot_description`: a path. Throws std::invalid_argument: parameter, what was expected, the
// nearest valid name.
ParameterScene scene_from_parameters(const FlatParameters& parameters,
                                     const std::function<std::string(const HostedArm&)>& model_of = {});

}  // namespace multipanda
