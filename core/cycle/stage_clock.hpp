#pragma once

#include <cstdint>

#include "core/record/cycle_record.hpp"

namespace multipanda {

// Times the stages of one step that began at `start`: from the tick's own time, so that they add up to no
// more than the step.
class StageClock {
 public:
  StageClock(StageTimes& times, HostTime start) : times_(times), start_(start), last_(start) {}
  void lap(std::int32_t StageTimes::*stage) {
    const HostTime now = host_now();
    times_.*stage = static_cast<std::int32_t>((now - last_).count());
    times_.total = static_cast<std::int32_t>((now - start_).count());
    last_ = now;
  }

 private:
  StageTimes& times_;
  HostTime start_, last_;
};

}  // namespace multipanda
