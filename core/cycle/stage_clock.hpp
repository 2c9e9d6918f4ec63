#pragma once

#include <cstdint>

#include "core/record/cycle_record.hpp"

namespace multipanda {

// Times the stages of one step.
class StageClock {
 public:
  explicit StageClock(StageTimes& times) : times_(times), start_(host_now()), last_(start_) {}
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
