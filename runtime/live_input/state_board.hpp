#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// The newest state of a run, for whoever watches it from outside. The thread that takes the loop's records
// hands them on; the loop itself knows nothing of it.
class StateBoard {
 public:
  struct Arm {
    ArmSample sample;
    ArmFrames frames;               // in force, once the loop told them
    std::string last_intervention;  // its rule, "reference_stale"; empty: none
  };
  struct Snapshot {
    std::uint64_t cycle = 0;  // 0: none yet
    LoopTime t;
    double rate_hz = 0;   // cycles per second on the wall, over the last half second or so
    double cycle_us = 0;  // how long the newest cycle took
    std::uint64_t overruns = 0;
    std::vector<Arm> arms;
  };

  explicit StateBoard(std::size_t arm_count);

  // --- the thread that takes the records ---
  void take(const CycleRecord& record);
  void take(const Event& event);

  // --- any other thread ---
  void copy(Snapshot& snapshot) const;

 private:
  using Clock = std::chrono::steady_clock;
  mutable std::mutex mutex_;
  Snapshot newest_;  // guarded by mutex_
  std::uint64_t window_cycle_ = 0;
  Clock::time_point window_begin_;
};

}  // namespace multipanda
