#pragma once

#include "core/rt/thread_setup.hpp"
#include "doctor/distribution.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

// How late a thread that is set up as the loop's wakes, once per millisecond.
struct TimerReading {
  std::vector<double> late_us;      // one per wake-up
  std::uint64_t missed = 0;         // periods slept through
  std::uint64_t missed_in_row = 0;  // most at once
  std::vector<SetupStep> setup;     // what the thread was given
};
// Takes `seconds`; nothing else runs meanwhile in this process.
TimerReading read_timer(double seconds);

// Later than this, an arm's torque does not come in time: it waits about 0.3 ms for the answer to its state.
inline constexpr double kAnswerLimit_us = 300;
// As many periods without a torque stop the arm.
inline constexpr std::uint64_t kLostInRowLimit = 20;

Finding judge_timer(const TimerReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
