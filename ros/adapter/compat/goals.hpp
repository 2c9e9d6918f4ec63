#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/types/joints.hpp"
#include "core/types/time.hpp"
#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/message_type.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/controllets/inputs.hpp"
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

// The goals of multipanda_ros2, /<resources>/<its controllet>/desired_pose, as streams of our inputs, with
// their checks, limits and timeouts. Also refuses goals under a name that was not requested, goals far from
// the arm, and goals while the arm's state is too old.
class CompatGoals : public AdapterPart {
 public:
  // Throws std::invalid_argument for missing or unsuitable types.
  CompatGoals(const AdapterContext& run, const CompatPackages& packages, const Inputs& inputs,
              std::shared_ptr<AskedNames> names);
  void take(const CycleRecord& record) override { arms_.take(record); }
  void take(const Event& event) override { arms_.take(event); }

 private:
  using Receive = UntypedSubscription::Callback;  // may throw std::invalid_argument, which refuses the
                                                  // message
  // One pose of a message for one input, in the base of the input's arm.
  struct PoseGoal {
    InputPort* port;
    Numbers numbers;
    std::string frame;
    ArmIndex arm;
  };
  void open(const TheirControllet& theirs, InstanceIndex instance, const CompatPackages& packages,
            const Inputs& inputs);
  Receive receive_joints(InputPort& to, const MessageType& type, ArmIndex arm);
  Receive receive_velocities(InputPort& to, const MessageType& type, ArmIndex arm, InstanceIndex instance);
  Receive receive_poses(std::vector<PoseGoal> goals, const Instance& law);
  void take_poses(const std::vector<PoseGoal>& goals, const void* message, double waited_s);
  std::string not_asked_for(InstanceIndex instance, const std::string& name);

  const AdapterContext& run_;
  std::shared_ptr<AskedNames> names_;
  MeasuredArms arms_;
  std::vector<std::unique_ptr<UntypedSubscription>> subscriptions_;
};

// Joint velocities as a stream of positions: each message moves the set-point for the time since the previous
// one, starting at the arm's position after a pause. One thread.
class VelocityGoal {
 public:
  // `timeout_s`: after a longer pause the next message starts where the arm is. A set-point more than kWindow
  // from the arm is refused, as in multipanda_ros2.
  VelocityGoal(JointVector dq_max, double timeout_s) : dq_max_(std::move(dq_max)), timeout_s_(timeout_s) {}
  static constexpr double kWindow = 0.1;   // [rad]
  static constexpr double kFirst = 0.001;  // duration of the first message's motion [s]

  // The next set-point [rad] for dq [rad/s]; the arm was at q `age_s` before. A joint whose
  // velocity becomes 0 stays where it is. Throws std::invalid_argument with the reason if it is refused; the
  // next message then starts where the arm is.
  //
  // A set-point that ran away presses against something, possibly a person. Restarting at the arm's
  // position would press again and again, so that joint is refused until its velocity is 0 or reversed, or
  // until a pause.
  JointVector next(const JointVector& dq, const JointVector& q, double age_s, HostTime now);
  void restart() { started_ = false; }

 private:
  struct RanAway {
    Eigen::Index joint = 0;
    double side = 1;  // sign of set-point minus position
  };

  JointVector dq_max_;
  double timeout_s_;
  bool started_ = false;
  HostTime last_{}, heard_{};  // newest accepted message; newest message
  JointVector q_d_, dq_;
  std::optional<RanAway> ran_away_;
};

}  // namespace multipanda::ros
