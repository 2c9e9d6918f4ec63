#pragma once

#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda::ros {

// Measured arm poses, for refusing goals that are far away.
class MeasuredArms {
 public:
  explicit MeasuredArms(const RunContext& run);

  // --- publisher's thread ---
  void take(const CycleRecord& record);
  void take(const Event& event);

  // --- executor's thread ---
  // Both throw std::invalid_argument before the first record, end_effector() also as check_age() does.
  struct Joints {
    JointVector q;     // (n x 1) [rad]
    double age_s = 0;  // age of the measurement
  };
  Joints joints(ArmIndex arm, HostTime now) const;
  Pose end_effector(ArmIndex arm, HostTime now);  // X_WE

 private:
  struct Arm {
    JointVector q;
    double age_s = 0;  // at the start of the cycle
    Pose X_FE;
  };
  mutable std::mutex mutex_;  // protects:
  std::vector<Arm> arms_;
  HostTime start_{};  // of the newest record's cycle
  bool seen_ = false;

  std::vector<ModelTerms> terms_;  // executor's thread; of the flanges
};

// Records stop while a reader blocks the publisher's thread, or while the run is paused: the arm may have
// moved since. Throws std::invalid_argument above kOldestState.
inline constexpr double kOldestState = 0.05;  // [s]
void check_age(double age_s);

// Why a goal is too far from the arm; empty: it is not. The distances are those of multipanda_ros2. They
// refuse goals that were never filled in or are in another frame, and streams of trajectories that continued
// while the arm did not move.
inline constexpr double kFarthestPosition = 0.1;   // [m]
inline constexpr double kFarthestRotation = 0.15;  // [rad]
inline constexpr double kFarthestJoint = 0.1;      // [rad]
std::string too_far(const Pose& X_goal, const Pose& X_measured);
std::string too_far(std::span<const double> q_goal, const JointVector& q_measured);

}  // namespace multipanda::ros
