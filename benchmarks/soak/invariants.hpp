#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "arm_interface/arm_error.hpp"
#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/joints.hpp"

namespace multipanda {

// A violated invariant in one cycle.
struct BrokenInvariant {
  double at_s = 0;
  std::string what;
};

// Checks every cycle of an endurance run, from records and counters only.
class Invariants {
 public:
  // Counters of an arm's side.
  struct ArmCount {
    std::uint64_t periods_missed = 0, motions_ended = 0;
    double torque_rate_max = 0;  // of the received torques [N m/s]
    ReflexDetail last_reflex;
  };
  struct ArmBounds {
    JointVector tau_max, tau_rate_max;
  };
  Invariants(RecordLayout layout, std::vector<ArmBounds> bounds);

  // `active`: instance bits. `disturbed`: arms with a present or very recent fault.
  void check(const CycleRecord& cycle, std::uint64_t active, std::span<const ArmCount> counts,
             ArmSet disturbed);
  // An event of this cycle: an arm without a fault must stay with its controllet.
  void check(const Event& event, ArmSet disturbed);

  std::uint64_t cycles() const { return cycles_; }
  std::uint64_t count() const { return count_; }  // of violations; only the first ones are stored
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

// The work of an arm's commanded torque, computed twice: by the arm in every period, and by the program from
// the received states. Work hidden by lost states is summed as unseen.
class WorkBalance {
 public:
  // The arm: after each period, its position and the torque that acts from now on (nullptr: its own).
  void arm_period(const JointVector& q, const JointVector* tau);
  // The program: a new state; `seen`: the previous one was of the preceding period. `counts`: the arm was in
  // torque control in both.
  void state(const JointVector& q, const JointVector& tau_in_use, bool seen, bool counts);

  double of_arm() const { return arm_; }          // [J]
  double of_program() const { return program_; }  // [J]
  double unseen() const { return unseen_; }       // magnitude of the work during missing states [J]
  double difference() const { return program_ - arm_; }

 private:
  double arm_ = 0, program_ = 0, unseen_ = 0;
  JointVector q_arm_, tau_arm_, q_program_, tau_program_;
  bool arm_commanded_ = false;
};

}  // namespace multipanda
