#pragma once

#include <cstdint>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

// What one scene's control cycle costs on this computer, and what it does that no loop must.
struct ControlCycleReading {
  std::string scene;
  std::string reason;  // why it could not be measured; empty: it was
  std::uint64_t cycles = 0;
  double p50 = 0, p99 = 0, p999 = 0, worst = 0;  // [us], without the simulator's own step
  bool guarded = false;                          // calls were counted, not only page faults
  bool memory_locked = false;                    // else page faults are to be expected
  std::uint64_t heap_calls = 0, lock_calls = 0, page_faults = 0;
  // Interruptions of the measuring thread: a worst cycle with many of them is not the controllers' doing.
  std::uint64_t interruptions = 0;
};
// Runs the scene simulated and unpaced for some thousand cycles in a program of its own beside this one,
// which counts heap calls and locks; here, they must stay as they are.
ControlCycleReading read_control_cycle(const std::string& scene, std::uint64_t cycles);
// What that program writes. Throws std::runtime_error if it is none of it.
ControlCycleReading parse_control_cycle(const std::string& json);

Finding judge_control_cycle(const ControlCycleReading& reading, Purpose purpose);
Finding judge_loop_guard(const ControlCycleReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
