#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "core/types/arm_set.hpp"
#include "device/arm_error.hpp"

namespace multipanda {

// What must never happen, seen in one cycle.
struct BrokenInvariant {
  double at_s = 0;
  std::string what;
};

// Checks every cycle of an endurance run. It knows the records and counters only, not how they came about.
class Invariants {
 public:
  // What an arm's side counted so far.
  struct ArmCount {
    std::uint64_t periods_missed = 0, motions_ended = 0;
    double torque_rate_max = 0;  // of the torques that it took [N m/s]
    ReflexDetail last_reflex;
  };
  struct ArmBounds {
    JointVector tau_max, tau_rate_max;
  };
  Invariants(RecordLayout layout, std::vector<ArmBounds> bounds);

  // `active`: instance bits. `disturbed`: arms on which a fault acts, or acted until a moment ago.
  void check(const CycleRecord& cycle, std::uint64_t active, std::span<const ArmCount> counts,
             ArmSet disturbed);
  // An event of this cycle: an arm without a fault is not taken from its controllet.
  void check(const Event& event, ArmSet disturbed);

  std::uint64_t cycles() const { return cycles_; }
  std::uint64_t count() const { return count_; }  // of violations; the first ones are kept
  const std::vector<BrokenInvariant>& violations() const { return violations_; }
  void report(double at_s, std::string what);

 private:
  RecordLayout layout_;
  std::vector<ArmBounds> bounds_;
  std::vector<ArmCount> before_;
  std::vector<int> states_;  // of each arm, up to 2
  std::uint64_t last_cycle_ = 0, cycles_ = 0, count_ = 0;
  std::vector<BrokenInvariant> violations_;
};

}  // namespace multipanda
