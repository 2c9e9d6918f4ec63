#pragma once

#include <optional>

#include "core/types/time.hpp"

namespace multipanda::cockpit {

// Whether an operator holds a button, from beats that the page sends while the button is pressed. One thread;
// the caller provides the clock.
class DeadMan {
 public:
  static constexpr double kTimeout = 0.2;  // without a beat for this time, it counts as released [s]

  void beat(HostTime now) { last_ = now; }
  void release() { last_.reset(); }
  // Between a beat and the following release or silence.
  bool begun() const { return last_.has_value(); }
  bool held(HostTime now) const { return last_ && seconds(now - *last_) <= kTimeout; }
  // The beats have stopped without a release.
  bool silent(HostTime now) const { return begun() && !held(now); }

 private:
  std::optional<HostTime> last_;  // beat
};

}  // namespace multipanda::cockpit
