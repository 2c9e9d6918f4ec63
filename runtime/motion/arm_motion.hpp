#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/trajectory/joint_motion.hpp"
#include "core/trajectory/pose_motion.hpp"
#include "runtime/run_adapter.hpp"

// Motions that are requested once and executed outside of the loop: a plan is streamed to the input of the
// impedance controllet that drives the arm, one sample per record. No ROS here.
namespace multipanda {

// How a motion ended. After `reached` the set-point is at rest at the goal.
enum class MotionResult {
  reached,
  canceled,        // braked to rest
  preempted,       // a newer motion took over
  lost,            // the arm left its controllet, or another client moves the input
  path_tolerance,  // too far from the path; braked to rest
  goal_tolerance,  // not close enough to the goal in time
};

struct MotionProgress {
  double time_s = 0, duration_s = 0;  // since its start; total duration
  std::size_t point = 0;              // index of the given point that it approaches
  JointSample desired;                // of joint motions
  JointVector q, dq;                  // measured [rad, rad/s] (n x 1)
};

// Receives progress and end of a motion. Called from two threads (publisher's, executor's), never
// concurrently. Must not call the motion.
class MotionListener {
 public:
  virtual ~MotionListener() = default;
  virtual void progress(const MotionProgress& progress) = 0;  // about 20 times a second of the loop's time
  virtual void over(MotionResult end, const std::string& why) = 0;  // once, as the last call
};

// A motion that cannot start. The message says what was expected and what to do.
struct MotionRefused : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

struct ViaPose {
  Vector3 p_WE;                 // [m]
  std::optional<Matrix3> R_WE;  // none: unchanged
};

// A trajectory as in FollowJointTrajectory, in the arm's order of joints.
struct TrajectoryGoal {
  std::vector<TrajectoryPoint> points;  // n joints each; the position of unnamed joints is NaN
  // (n x 1) or empty; 0: not monitored
  JointVector path_position, path_velocity, goal_position, goal_velocity;
  // time for reaching the goal's tolerances after the end of the trajectory
  double goal_time_s = kDefaultGoalTime;
  double delay_s = 0;  // until the start

  static constexpr double kDefaultGoalTime = 2.0;
};

// Executes motions of one arm, one at a time. A newer motion takes over smoothly from the current one.
class ArmMotion {
 public:
  // Limits of set-points, lower than the arm's, so that a control law does not turn them into jerks.
  static constexpr double kAcceleration = 5, kJerk = 60;                // of joints [rad/s^2, rad/s^3]
  static constexpr double kLinearAcceleration = 1.8, kLinearJerk = 30;  // [m/s^2, m/s^3]
  // The first point of a trajectory may be this far from the set-point, which replaces it.
  static constexpr double kStartTolerance = 0.1;  // [rad]

  // `run` must outlive this object. `paced`: the loop follows the wall clock, so a record's delay shows the
  // loop's progress; otherwise the loop waits for its records.
  ArmMotion(const RunContext& run, ArmIndex arm, bool paced = true);
  ~ArmMotion();  // brings a running motion to rest
  ArmMotion(const ArmMotion&) = delete;

  // One thread, not the loop's.
  // Returns whether records have reached `since` and contain the controllet that is active now. After a
  // switch or on a busy machine this takes a moment; until then records may be outdated.
  bool ready(Quantity quantity, HostTime since) const;
  // These functions throw MotionRefused and change nothing, or accept the listener. Planning
  // takes milliseconds.
  void through_joints(std::span<const JointVector> via, double scale,
                      std::shared_ptr<MotionListener> listener);
  void through_poses(std::span<const ViaPose> via, double scale, std::shared_ptr<MotionListener> listener);
  void follow(const TrajectoryGoal& goal, std::shared_ptr<MotionListener> listener);
  // Brakes to rest if this listener's motion is running; its over() follows when it is at rest.
  bool cancel(const MotionListener& listener);

  // Publisher's thread. An event may come one record late: until then one more sample is posted.
  void take(const Event& event);
  void take(const CycleRecord& record);

 private:
  using Motion = std::variant<JointMotion, PoseMotion>;
  using Start = std::variant<JointSample, PoseSample>;
  struct Input {
    InstanceIndex instance = 0;
    std::size_t input = 0;
  };
  struct Run {
    Input input;
    Motion motion;
    std::int64_t t0 = kNow;  // loop's time [ns]
    std::shared_ptr<MotionListener> listener;
    TrajectoryGoal watch;  // its tolerances
    std::vector<double> knots;
    bool braking = false, goal_sent = false;
    MotionResult end = MotionResult::reached;  // result once it is at rest
    std::string why;
    std::int64_t last_progress = kNow;
  };
  static constexpr std::int64_t kNow = -1;

  Input find_input(Quantity quantity) const;  // throws MotionRefused
  std::optional<Input> active_input(Quantity quantity) const;
  const InputSpec& spec(const Input& input) const;
  JointMotionLimits joint_limits(const Input& input) const;
  PoseMotionLimits pose_limits(const Input& input) const;
  // The highest speed in a joint motion, of the hand or of the bodies moved by a prismatic joint, and the
  // scene's bound for contact; the loop would slow down a faster set-point, which would then arrive late.
  double top_hand_speed(const JointMotion& motion) const;
  double allowed_hand_speed(const Input& input) const;
  JointMotion via_motion(const JointSample& start, std::span<const JointVector> via, const Input& input,
                         double scale) const;
  const char* unit_of(Eigen::Index joint) const;  // of its position: rad, of a prismatic joint m
  // Both throw MotionRefused for motions that the input does not accept.
  void check_goal(const Input& input, const Target& goal) const;
  void check_joints(const Input& input, const JointVector& q) const;
  void check_trajectory(const JointMotion& motion, const Input& input) const;
  void begin(Quantity quantity, const std::function<Motion(const Start&, const Input&)>& plan,
             TrajectoryGoal watch, std::shared_ptr<MotionListener> listener);

  // With mutex_
  const ReferenceSample* latest(const Input& input) const;
  Start start_of(const Input& input) const;
  void brake(Run& run, MotionResult end, std::string why);
  void end(MotionResult end, const std::string& why);
  bool watch_path(Run& run, const ArmSample& arm, double t);
  bool post(const Run& run, double t, Delivery delivery);
  std::int64_t behind(const CycleRecord& record) const;
  void notify(Run& run, const ArmSample& arm, double t);
  void settle(Run& run, const ArmSample& arm, double t);
  double off_goal(const Run& run) const;

  const RunContext& run_;
  const ArmIndex arm_;
  const std::size_t n_;
  const bool paced_;

  mutable std::mutex mutex_;
  std::deque<Run> runs_;   // the first one moves; the next one takes over at its t0
  std::int64_t t_ = kNow;  // the loop's time according to the newest record
  // Data of the newest record.
  HostTime start_;
  std::vector<ReferenceSample> references_;  // of this arm's instances
};

}  // namespace multipanda
