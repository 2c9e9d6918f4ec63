#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"

namespace multipanda {

// The controllets and features that can be named. One explicit list, no self-registration: what is linked is
// visible in one place. Filled before the loop; read-only afterwards.
class Registry {
 public:
  // Everything that comes with multipanda.
  static Registry with_builtins();

  // Throws std::invalid_argument on a name that is taken.
  void add(ControlletType type);
  void add(FeatureType type);

  const ControlletType* controllet(std::string_view type) const;  // nullptr: unknown
  const FeatureType* feature(std::string_view type) const;
  const std::vector<ControlletType>& controllets() const { return controllets_; }
  const std::vector<FeatureType>& features() const { return features_; }

  // Loads a user's library (core/modes/plugin.hpp says what it exports) and adds its controllets and
  // features. Throws std::runtime_error with the reason: not found, unresolved symbol, other version. Never
  // unloaded.
  void load_plugin(const std::string& path);

 private:
  std::vector<ControlletType> controllets_;
  std::vector<FeatureType> features_;
};

}  // namespace multipanda
