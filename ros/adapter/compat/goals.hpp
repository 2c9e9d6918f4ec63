#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/packages.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/controllets/inputs.hpp"

namespace multipanda::ros {

// A velocity of joints as a stream of positions: each message moves the set-point for the time since the one
// before, from where the arm is after a pause. One thread.
class VelocityGoal {
 public:
  // `timeout_s`: after a longer pause the next message starts where the arm is. A set-point more than kWindow
  // from the arm is refused, as in multipanda_ros2.
  VelocityGoal(JointVector dq_max, double timeout_s) : dq_max_(std::move(dq_max)), timeout_s_(timeout_s) {}
  static constexpr double kWindow = 0.1;   // [rad]
  static constexpr double kFirst = 0.001;  // for which the first message counts [s]

  // The next set-point [rad] for dq [rad/s] at a time, the arm being at q. Throws std::invalid_argument that
  // says why it is refused; the next message then starts where the arm is.
  JointVector next(const JointVector& dq, const JointVector& q, HostTime now);
  void restart() { started_ = false; }

 private:
  JointVector dq_max_;
  double timeout_s_;
  bool started_ = false;
  HostTime last_{};
  JointVector q_d_;
};

// The goals of multipanda_ros2, /<resources>/<its controllet>/desired_pose, as streams of our inputs, with
// their checks, limits and timeouts.
class CompatGoals : public AdapterPart {
 public:
  // Throws std::invalid_argument for missing types, and for types that do not fit.
  CompatGoals(const AdapterContext& run, const CompatPackages& packages, const Inputs& inputs);
  void take(const CycleRecord& record) override;

 private:
  void open(const TheirControllet& theirs, InstanceIndex instance, const CompatPackages& packages,
            const Inputs& inputs);
  JointVector measured(ArmIndex arm) const;

  const AdapterContext& run_;
  mutable std::mutex mutex_;
  std::vector<JointArray> q_;  // newest, per arm
  bool seen_ = false;
  std::vector<std::unique_ptr<UntypedSubscription>> subscriptions_;
};

}  // namespace multipanda::ros
