#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"
#include "core/modes/backend_type.hpp"

namespace multipanda {

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
