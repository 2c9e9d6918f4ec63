#pragma once

#include "core/rt/thread_setup.hpp"
#include "doctor/distribution.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

// Lateness of a thread with the loop's set-up that wakes once per millisecond.
struct TimerReading {
  std::vector<double> late_us;      // one per wake-up
  std::uint64_t missed = 0;         // missed periods
  std::uint64_t missed_in_row = 0;  // largest number of successive ones
  std::vector<SetupStep> setup;     // results of the thread's set-up
};
// Takes `seconds`. Nothing else runs in this process meanwhile.
TimerReading read_timer(double seconds);

inline constexpr double kPeriod_us = 1000;  // of an arm
// Latest arrival of a torque: an arm waits about 0.3 ms for the answer to its state.
inline constexpr double kAnswerLimit_us = 300;
// Number of successive periods without a torque that stops an arm.
inline constexpr std::uint64_t kLostInRowLimit = 20;

Finding judge_timer(const TimerReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
