#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"
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
    JointVector q_start;  // start of a simulated arm [rad] (n x 1)
  };
  std::vector<Arm> arms;  // in the order of the scene; the backend has the same arms in the same order
  bool paced = true;      // by the wall clock; false: as fast as possible
  // Sends the user a message. From any thread but the loop's, one call at a time.
  std::function<void(const std::string&)> report;
};

// A backend that a scene or the command line can name (docs/writing_a_controllet.md).
struct BackendType {
  std::string name;
  std::string doc;  // one sentence
  // Called before the loop. Throws std::exception if the arms are not available.
  std::function<std::unique_ptr<Backend>(const BackendSetup&)> create;
};

// The controllets, features and users' backends that a scene can name. The list is explicit, without
// self-registration. It is filled before the loop, with users' libraries by core/plugin/load_plugin.hpp, and
// read-only afterwards.
class Registry {
 public:
  // All controllets and features of multipanda.
  static Registry with_builtins();

  // Throws std::invalid_argument if the name is taken.
  void add(ControlletType type);
  void add(FeatureType type);
  void add(BackendType type);

  const ControlletType* controllet(std::string_view type) const;  // nullptr: unknown
  const FeatureType* feature(std::string_view type) const;
  const BackendType* backend(std::string_view name) const;  // nullptr: unknown
  const std::vector<ControlletType>& controllets() const { return controllets_; }
  const std::vector<FeatureType>& features() const { return features_; }
  const std::vector<BackendType>& backends() const { return backends_; }

 private:
  std::vector<ControlletType> controllets_;
  std::vector<FeatureType> features_;
  std::vector<BackendType> backends_;
};

}  // namespace multipanda
