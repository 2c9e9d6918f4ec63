#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "backends/arm/motion_limits.hpp"
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
  double period_s = 0;        // since the cycle before
  std::int32_t total_ns = 0;  // computing time of the whole cycle
  bool others_due = false;    // a packet of another arm had come
  ArmSample arm;
};

// What is known of an arm's limits when its errors are explained.
struct ArmErrorLimits {
  std::size_t joint_count = 0;
  MotionLimits motion;
  JointVector tau_max;       // [N m] (n x 1)
  JointVector tau_rate_max;  // [N m/s] (n x 1)
  // Of contact, as told to the arm; none: it has its own, which it does not tell.
  std::optional<SetCollisionThresholds> thresholds;
  std::optional<double> power_max;      // [W]; none: not published
  std::optional<double> self_distance;  // parts of the arm must keep apart [m]; none: not published
  double velocity_margin = 1;           // the arm tolerates so many times its velocity limits
  std::shared_ptr<const ArmModel> model;
  ArmFrames frames;
  Load tool, load;
};

// Pure: the errors (bit i: ArmError i) and the arm's last cycles, oldest first; the last is the one in which
// the errors were first seen. What the records cannot tell is said to be unknown.
ErrorExplanation explain(std::uint64_t errors, std::span<const ArmCycle> cycles,
                         const ArmErrorLimits& limits);

// What to do about an error, one sentence.
std::string_view cure(ArmError error);

}  // namespace multipanda
