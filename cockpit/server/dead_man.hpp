#pragma once

#include <optional>

#include "core/types/time.hpp"

namespace multipanda::cockpit {

// Whether an operator holds a button, from beats that the page sends while it reads the button as pressed.
// One thread; the caller has the clock.
class DeadMan {
 public:
  static constexpr double kTimeout = 0.2;  // without a beat, nobody holds [s]

  void beat(HostTime now) { last_ = now; }
  void release() { last_.reset(); }
  // Between a beat and the release, or the silence, that follows it.
  bool begun() const { return last_.has_value(); }
  bool held(HostTime now) const { return last_ && seconds(now - *last_) <= kTimeout; }
  // The beats have stopped without a release.
  bool silent(HostTime now) const { return begun() && !held(now); }

 private:
  std::optional<HostTime> last_;  // beat
};

}  // namespace multipanda::cockpit
