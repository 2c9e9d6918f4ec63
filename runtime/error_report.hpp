#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "backends/simulated_arm/motion_limits.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "runtime/reflex_report.hpp"

namespace multipanda {

// One arm's part of a cycle's record.
struct ArmCycle {
  std::uint64_t cycle = 0;
  LoopTime t;
  double period_s = 0;        // since the previous cycle
  std::int32_t total_ns = 0;  // computing time of the whole cycle
  bool others_due = false;    // a packet of another arm had arrived
  ArmSample arm;
};

// Limits of an arm, to explain its errors.
struct ArmErrorLimits {
  std::size_t joint_count = 0;
  MotionLimits motion;
  JointVector tau_max;       // [N m] (n x 1)
  JointVector tau_rate_max;  // [N m/s] (n x 1)
  // Contact thresholds sent to the arm; none: its own, which are unknown.
  std::optional<SetCollisionThresholds> thresholds;
  std::optional<double> power_max;      // [W]; none: not published
  std::optional<double> self_distance;  // smallest distance of two parts of the arm [m]; none: not published
  double velocity_margin = 1;           // factor on the velocity limits that the arm tolerates
  std::shared_ptr<const ArmModel> model;
  ArmFrames frames;
  Load tool, load;
  // Its base moves with another arm, or it carries one, whose records are not looked at: what it estimated
  // itself is not what the loop did.
  bool beside_moving_base = false;
};

// Explains errors (bit i: ArmError i) from the arm's last cycles, oldest first. The last cycle is the one in
// which the errors were first seen. The explanation names what the records do not show.
ErrorExplanation explain(std::uint64_t errors, std::span<const ArmCycle> cycles,
                         const ArmErrorLimits& limits);

// How to fix an error, one sentence.
std::string_view cure(ArmError error);

}  // namespace multipanda
