#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// The arm's report on received commands: each packet of a motion has the success rate of its last 100
// periods. Counts missed commands and detects a low rate. One thread; no allocation.
class CommandSuccess {
 public:
  static constexpr double kLow = 0.9;   // [1]
  static constexpr double kPause = 60;  // [s] between two warnings
  static constexpr int kPeriods = 100;  // window of the arm's rate; invalid in shorter motions
  // A motion begins before its first command. The arm counts these periods as missed, up to its tolerance;
  // they cause no warning.
  static constexpr int kBeginning = 20;

  // A packet with its number (one per period), at the time `t_s`. `moves`: in a motion.
  void take(std::uint64_t number, bool moves, double share, double t_s) {
    const std::uint64_t periods = number > last_ ? std::min<std::uint64_t>(number - last_, kPeriods) : 0;
    last_ = number;
    if (!moves) {
      moved_ = 0;
      return;
    }
    // The numbers do not show when the motion began; its first packet is the first to do so.
    moved_ = moved_ == 0 ? 1 : std::min<std::uint64_t>(moved_ + periods, kPeriods + kBeginning + 1);
    if (moved_ <= kPeriods || periods == 0) return;
    // A missed command affects kPeriods rates, with the weight 1 / kPeriods.
    missed_ += (1 - std::clamp(share, 0.0, 1.0)) * static_cast<double>(periods);
    if (moved_ <= kPeriods + kBeginning) return;
    if (share >= kLow || (warned_ && t_s - warned_at_s_ < kPause)) return;
    warned_ = low_ = true;
    warned_at_s_ = t_s;
  }
  void take(const ArmSample& sample) {
    take(sample.sequence, sample.mode == static_cast<std::uint8_t>(ArmMode::move),
         sample.command_success_rate, 1e-9 * static_cast<double>(sample.t_robot_ns));
  }
  std::uint64_t missed() const { return static_cast<std::uint64_t>(std::llround(missed_)); }
  // Whether the rate fell below kLow since the last call; at most once per kPause.
  bool take_low() {
    const bool low = low_;
    low_ = false;
    return low;
  }

 private:
  std::uint64_t last_ = 0, moved_ = 0;
  double missed_ = 0, warned_at_s_ = 0;
  bool warned_ = false, low_ = false;
};

}  // namespace multipanda
