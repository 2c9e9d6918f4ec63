#pragma once

#include "core/plugin/layout.hpp"

#if __has_include(<multipanda_headers_hash.hpp>)
#include <multipanda_headers_hash.hpp>
#else
#error "CMakeLists.txt: find_package(multipanda) and build the library by multipanda_plugin(NAME SOURCES...)"
#endif

// Exports controllets, features and backends from a user's shared library:
//
//   MULTIPANDA_PLUGIN(registry) { registry.add(my_controllet()); }
//
// The library carries the hash of the headers it was compiled with and the layout of the types in them. The
// program refuses a library for which either differs from its own.

// The argument is the name of a function parameter, which cannot be parenthesized.
// NOLINTBEGIN(bugprone-macro-parentheses)
#define MULTIPANDA_PLUGIN(registry)                                                            \
  extern "C" __attribute__((visibility("default"))) const char* multipanda_plugin_headers() {  \
    return MULTIPANDA_HEADERS_HASH;                                                            \
  }                                                                                            \
  extern "C" __attribute__((visibility("default"))) std::uint64_t multipanda_plugin_layout() { \
    return ::multipanda::kPluginLayout;                                                        \
  }                                                                                            \
  extern "C" __attribute__((visibility("default"))) void multipanda_plugin_register(           \
      ::multipanda::Registry& registry)
// NOLINTEND(bugprone-macro-parentheses)
