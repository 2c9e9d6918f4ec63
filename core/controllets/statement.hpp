#pragma once

#include <string>
#include <vector>

#include "core/controllets/parameters.hpp"
#include "core/reference/reference.hpp"

namespace multipanda {

// A number that a controllet shows to the outside: logged, plotted, published.
struct OutputSpec {
  std::string name;      // with its unit: "position_error_m"
  std::size_t size = 1;  // numbers
  std::string doc;
};

// What a controllet (or feature) is, as data, said once. Everything that talks to it is generated from this:
// scene files, the socket, docs, ROS interfaces. A controllet has no communication code of its own.
struct Statement {
  std::string type;      // "cartesian_impedance"
  std::string doc;       // one or two sentences
  std::size_t arms = 1;  // how many it owns
  std::vector<InputSpec> inputs;
  std::vector<ParameterSpec> parameters;
  std::vector<OutputSpec> outputs;
};

}  // namespace multipanda
