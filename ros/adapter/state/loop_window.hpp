#pragma once

#include <cstdint>
#include <vector>

#include "core/record/cycle_record.hpp"

namespace multipanda::ros {

// Timing of the loop since the last call of look(), computed from records. One thread.
class LoopWindow {
 public:
  // Number of cycles whose times are kept; a longer window keeps the newest.
  static constexpr std::size_t kKept = 1 << 16;

  struct Durations {  // [s]; NaN: none
    double median = 0, p99 = 0, worst = 0;
  };
  struct Figures {
    double window_s = 0;  // on the computer's clock
    std::uint64_t cycle = 0, cycles = 0;
    double rate_hz = 0;    // 0: fewer than two cycles
    Durations period;      // start of a cycle to start of the next, on the computer's clock
    Durations cycle_time;  // work of a cycle
    std::uint64_t overruns = 0, overruns_window = 0;
  };

  LoopWindow();
  void add(const CycleRecord& record);
  Figures finish();  // starts a new window with the newest record

 private:
  static Durations durations(std::vector<double>& values);
  void keep(std::vector<double>& values, double value) const;

  std::vector<double> periods_, cycle_times_;
  std::uint64_t added_ = 0;  // in this window
  bool any_ = false;
  bool counts_first_ = true;                        // in the first window, the first cycle completes no
                                                    // period
  std::uint64_t first_cycle_ = 0, last_cycle_ = 0;  // the first is the last one of the previous window
  HostTime first_start_, last_start_;
  std::uint64_t first_overruns_ = 0, last_overruns_ = 0;
};

}  // namespace multipanda::ros
