#pragma once

#include <array>
#include <cstdint>

#include "core/types/arm_set.hpp"

namespace multipanda::fci {

// The first cycle waits for a state of every arm. An arm that has begun must not go without answers until the
// last one has a state: it would stop itself after 20.
class FirstStates {
 public:
  // The arm's newest state has no answer, and states of other arms are missing. True: it is not the arm's
  // first one of this wait, and not held yet.
  bool is_to_be_held(ArmIndex arm, std::uint64_t number) {
    std::uint64_t& last = last_[arm];
    const bool further = last != 0 && number != last;
    last = number;
    return further;
  }

 private:
  std::array<std::uint64_t, kMaxArms> last_{};  // number of the newest state; 0: none yet
};

}  // namespace multipanda::fci
