#pragma once

#include <cstdint>

#include "core/rt/thread_setup.hpp"
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

// The cost of a scene's control cycle on this computer, and forbidden operations in it.
struct ControlCycleReading {
  std::string scene;
  std::string reason;  // why it was not measured; empty: measured
  std::uint64_t cycles = 0;
  double p50 = 0, p99 = 0, p999 = 0, worst = 0;  // [us], without the simulator's own step
  bool guarded = false;                          // calls were counted, not only page faults
  bool memory_locked = false;                    // otherwise page faults are expected
  std::uint64_t heap_calls = 0, lock_calls = 0, page_faults = 0;
  // Interruptions of the measuring thread: many of them explain a slow worst cycle.
  std::uint64_t interruptions = 0;
};
// Runs the simulated scene unpaced for some thousand cycles in a separate program, which counts heap calls
// and locks.
ControlCycleReading read_control_cycle(const std::string& scene, std::uint64_t cycles);
// Parses the output of that program. Throws std::runtime_error if it is invalid.
ControlCycleReading parse_control_cycle(const std::string& json);

Finding judge_control_cycle(const ControlCycleReading& reading, Purpose purpose);
Finding judge_loop_guard(const ControlCycleReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
