#pragma once

#include <cstddef>
#include <initializer_list>

#include <Eigen/Core>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/modes/registry.hpp"
#include "core/types/tick.hpp"

// Exports controllets, features and backends from a user's shared library:
//
//   MULTIPANDA_PLUGIN(registry) { registry.add(my_controllet()); }
//
// The library is compiled against these headers; the number below must match the program's. It contains the
// sizes of the types that both sides use and Eigen's alignment: a library built with -mavx would place its
// vectors elsewhere and crash at random, so the program refuses it.
namespace multipanda {

// Incremented whenever a header that controllets include changes without changing a size below, for example
// in the order of members or of virtual functions.
inline constexpr unsigned kPluginInterface = 4;

// FNV-1a over the numbers.
constexpr unsigned fold(std::initializer_list<std::size_t> numbers) {
  unsigned hash = 2166136261u;
  for (const std::size_t number : numbers) {
    for (unsigned shift = 0; shift < 32; shift += 8)
      hash = (hash ^ (static_cast<unsigned>(number >> shift) & 0xFFu)) * 16777619u;
  }
  return hash;
}

inline constexpr unsigned kPluginVersion = fold({kPluginInterface,       EIGEN_MAX_STATIC_ALIGN_BYTES,
                                                 sizeof(Registry),       sizeof(ControlletType),
                                                 sizeof(FeatureType),    sizeof(BackendType),
                                                 sizeof(BackendSetup),   sizeof(ControlletDescriptor),
                                                 sizeof(OwnedArm),       sizeof(ControlContext),
                                                 sizeof(FeatureContext), sizeof(ParameterSpec),
                                                 sizeof(ParameterSet),   sizeof(InputSpec),
                                                 sizeof(Reference),      sizeof(Target),
                                                 sizeof(Tick),           sizeof(ArmState),
                                                 sizeof(ModelTerms),     sizeof(ArmModel),
                                                 sizeof(ArmCommand),     sizeof(Capabilities),
                                                 sizeof(ArmRequest),     sizeof(GripperRequest),
                                                 sizeof(WorldRequest)});

}  // namespace multipanda

// The argument is the name of a function parameter, which cannot be parenthesized.
// NOLINTBEGIN(bugprone-macro-parentheses)
#define MULTIPANDA_PLUGIN(registry)                                                        \
  extern "C" __attribute__((visibility("default"))) unsigned multipanda_plugin_version() { \
    return ::multipanda::kPluginVersion;                                                   \
  }                                                                                        \
  extern "C" __attribute__((visibility("default"))) void multipanda_plugin_register(       \
      ::multipanda::Registry& registry)
// NOLINTEND(bugprone-macro-parentheses)
