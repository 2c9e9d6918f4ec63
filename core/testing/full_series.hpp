#pragma once

#include <cstdlib>

namespace multipanda::test {

// Whether long series run in full: MULTIPANDA_FULL is set, and neither empty nor 0. `./multipanda test
// --full` sets it.
inline bool full_series() {
  const char* full = std::getenv("MULTIPANDA_FULL");
  return full != nullptr && *full != '\0' && *full != '0';
}

}  // namespace multipanda::test
