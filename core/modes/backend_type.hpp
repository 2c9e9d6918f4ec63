#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

class Backend;  // core/cycle/backend.hpp

// The inputs from which a user's library builds a backend.
struct BackendSetup {
  struct Arm {
    std::string name;
    std::shared_ptr<const ArmModel> model;
    ArmFrames frames;
    Load tool, load;
    JointVector q_start;  // where a simulated arm starts [rad] (n x 1)
  };
  std::vector<Arm> arms;  // in the order of the scene; the backend has the same arms in the same order
  bool paced = true;      // to the wall clock; false: as fast as possible
  // Sends the user a message. From any thread but the loop's, one call at a time.
  std::function<void(const std::string&)> report;
};

// A backend that a scene or the command line can name (docs/writing_a_backend.md).
struct BackendType {
  std::string name;
  std::string doc;  // one sentence
  // Called before the loop. Throws std::exception if the arms are not available.
  std::function<std::unique_ptr<Backend>(const BackendSetup&)> create;
};

}  // namespace multipanda
