#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "arm_interface/command_success.hpp"
#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// "reference_stale"; none: empty.
std::string rule_name(Intervention rule);

// The newest state of a run, for clients. The thread that takes the loop's records updates it; the loop does
// not use it.
class LatestState {
 public:
  struct Arm {
    ArmSample sample;
    ArmFrames frames;                              // in force, once the loop has reported them
    std::string last_intervention;                 // its rule, "reference_stale"; empty: none
    Intervention removed_by = Intervention::none;  // its last controllet: note_removal()
    std::string stop_reason;                       // why the arm stopped itself; empty: it reports no error
    CommandSuccess success;                        // of the commands to it
  };
  struct Snapshot {
    std::uint64_t cycle = 0;  // 0: none yet
    LoopTime t;
    HostTime start;       // of the cycle
    double rate_hz = 0;   // cycles per second of wall time, over about half a second
    double cycle_us = 0;  // computing time of the newest cycle
    std::uint64_t overruns = 0;
    std::vector<Arm> arms;
  };

  explicit LatestState(std::size_t arm_count);

  // --- the thread that takes the records ---
  void take(const CycleRecord& record);
  void take(const Event& event);
  void take_stop_reason(std::size_t arm, std::string reason);  // after the record with the arm's error

  // --- any other thread ---
  void copy(Snapshot& snapshot) const;
  ArmSample sample(std::size_t arm) const;

 private:
  using Clock = std::chrono::steady_clock;
  mutable std::mutex mutex_;
  Snapshot newest_;  // guarded by mutex_
  std::uint64_t window_cycle_ = 0;
  Clock::time_point window_begin_;
};

}  // namespace multipanda
