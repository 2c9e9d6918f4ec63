#pragma once

#include <string>
#include <vector>

#include "core/controllets/parameters.hpp"
#include "core/reference/reference.hpp"

namespace multipanda {

// Declares one output of a controllet: numbers that are logged, plotted and published.
struct OutputSpec {
  std::string name;      // with its unit: "position_error_m"
  std::size_t size = 1;  // numbers
  std::string doc;
};

// Named values of several parameters, which a scene selects by `preset` under `parameters`. One number stands
// for all of a parameter; a parameter per joint may have more than the arm has joints.
struct Preset {
  struct Value {
    std::string parameter;
    std::vector<double> values;
  };
  std::string name;  // "paper"
  std::string doc;
  std::vector<Value> values;
};

// Declares a controllet or feature, as data. Scene files, the socket, docs and ROS interfaces are generated
// from it, so that a controllet contains no communication code.
struct ControlletDescriptor {
  std::string type;      // "cartesian_impedance"
  std::string doc;       // one or two sentences
  std::size_t arms = 1;  // number of arms that it owns
  // Number of arms that it reads and does not own: the leader of a follower. If one of them is lost, the
  // controllet is deactivated and its arms are held.
  std::size_t observes = 0;
  // Whether it may own or observe an arm that stands on another one, or that carries one: it keeps no pose in
  // coordinates of a base, and works on a moving base.
  bool moving_base = false;
  // Whether its torques act as a wrench of each hand on the world, J^T F, besides the self-motion. A carrier
  // then supports that wrench for the arm that stands on it.
  bool wrench_at_hand = false;
  // Whether a person moves its arms by hand, so that nothing pulls them back.
  bool guided = false;
  std::vector<InputSpec> inputs;
  std::vector<ParameterSpec> parameters;
  std::vector<OutputSpec> outputs;
  std::vector<Preset> presets = {};
};

}  // namespace multipanda
