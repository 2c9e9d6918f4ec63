#pragma once

#include "core/state/arm_state.hpp"

namespace multipanda {

// Both bodies on the flange as one, each with its share: x a + y b.
Load combined(const Load& a, double x, const Load& b, double y);

// The payload whose weight an arm compensates: a new declaration fades in within a second, so that an arm
// moves slowly if the load is not there, or was not declared before. No allocation.
class LoadRamp {
 public:
  static constexpr double kDuration = 1;  // [s]

  explicit LoadRamp(const Load& load = {}) : from_(load), to_(load), now_(load) {}
  void aim(const Load& load);  // from what it is now
  bool advance(double dt);     // true: now() has changed
  const Load& now() const { return now_; }

 private:
  Load from_, to_, now_;
  double share_ = 1;  // of to_
};

}  // namespace multipanda
