#pragma once

#include <Eigen/Core>

#include "core/modes/registry.hpp"

// Exports controllets, features and backends from a user's shared library:
//
//   MULTIPANDA_PLUGIN(registry) { registry.add(my_controllet()); }
//
// The library is compiled against these headers; the number below must match the program's, and so must
// Eigen's alignment: a library built with -mavx would place its vectors elsewhere and crash at random, so the
// program refuses it.
namespace multipanda {

// Incremented whenever a header that controllets include changes.
inline constexpr unsigned kPluginInterface = 3;
inline constexpr unsigned kPluginVersion = kPluginInterface * 1000u + EIGEN_MAX_STATIC_ALIGN_BYTES;

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
