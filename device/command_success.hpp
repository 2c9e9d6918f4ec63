#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// What an arm says about the commands that it received: in each packet of a motion the share of its last 100
// periods. Counts the commands that it missed, and notices a low share. One thread; nothing allocates.
class CommandSuccess {
 public:
  static constexpr double kLow = 0.9;   // [1]
  static constexpr double kPause = 60;  // [s] between two warnings
  static constexpr int kPeriods = 100;  // of the arm's share; it says nothing before a motion is as old
  // A motion begins before its first command, and an arm counts these periods as missed: not more than it
  // bears. No warning looks at them.
  static constexpr int kBeginning = 20;

  // A packet with its number (one per period), at the time `t_s`. `moves`: in a motion.
  void take(std::uint64_t number, bool moves, double share, double t_s) {
    const std::uint64_t periods = number > last_ ? std::min<std::uint64_t>(number - last_, kPeriods) : 0;
    last_ = number;
    if (!moves) {
      moved_ = 0;
      return;
    }
    // The numbers say nothing about when the motion began, which its first packet is the first to show.
    moved_ = moved_ == 0 ? 1 : std::min<std::uint64_t>(moved_ + periods, kPeriods + kBeginning + 1);
    if (moved_ <= kPeriods || periods == 0) return;
    // A missed command is part of kPeriods shares, with the weight 1 / kPeriods.
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
  // Whether the share fell below kLow since the last call; at most once per kPause.
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
