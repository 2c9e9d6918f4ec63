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
#include "generators/via_points/joint_motion.hpp"
#include "generators/via_points/pose_motion.hpp"
#include "runtime/run_adapter.hpp"

// Motions that are sent once and carried out from outside of the loop: a plan, streamed to the input of
// whatever impedance controllet drives the arm, one sample per record. No ROS in here.
namespace multipanda::ros {

// How a motion ended. Whoever gets `reached` finds the set-point at rest at the goal.
enum class MotionEnd {
  reached,
  cancelled,       // braked to rest
  preempted,       // a newer one took over, from its motion
  lost,            // the arm left its controllet, or somebody else moves the input
  path_tolerance,  // left the path too far; braked to rest
  goal_tolerance,  // did not get close enough to the goal in time
};

struct MotionProgress {
  double time_s = 0, duration_s = 0;  // since its start; of the whole
  std::size_t point = 0;              // of those given, that it moves to
  JointSample desired;                // of motions of joints
  JointVector q, dq;                  // measured [rad, rad/s] (n x 1)
};

// Who wants to know. Any of two threads (publisher's, executor's), one at a time; must not call the motion.
class MotionListener {
 public:
  virtual ~MotionListener() = default;
  virtual void progress(const MotionProgress& progress) = 0;     // about 20 times a second of the loop's time
  virtual void over(MotionEnd end, const std::string& why) = 0;  // once, the last one
};

// What cannot be begun: what was expected, and what to do.
struct MotionRefused : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

struct ViaPose {
  Vector3 p_WE;                 // [m]
  std::optional<Matrix3> R_WE;  // none: as before
};

// As FollowJointTrajectory asks for it, in the arm's own order of joints.
struct TrajectoryGoal {
  std::vector<TrajectoryPoint> points;  // n joints each; the position of joints that are not named is NaN
  // (n x 1) or empty; 0: not watched
  JointVector path_position, path_velocity, goal_position, goal_velocity;
  double goal_time_s = kDefaultGoalTime;  // for the goal's tolerances, after the end of the trajectory
  double delay_s = 0;                     // until it begins

  static constexpr double kDefaultGoalTime = 2.0;
};

// The motions of one arm; one at a time, a newer one takes over smoothly from wherever the older one is.
class ArmMotion {
 public:
  // Set-points stay this much below what a law would pass on as jerks, whatever the arm could do.
  static constexpr double kAcceleration = 5, kJerk = 60;                // of joints [rad/s^2, rad/s^3]
  static constexpr double kLinearAcceleration = 1.8, kLinearJerk = 30;  // [m/s^2, m/s^3]
  // A trajectory begins where the arm is: its first point may be this far from the set-point, which replaces
  // it.
  static constexpr double kStartTolerance = 0.1;  // [rad]

  // `world` outlives it. Paced: the loop keeps to the wall clock, so that a record that comes late says how
  // far the loop is by now; else the loop waits for its records.
  ArmMotion(const RunWorld& world, ArmIndex arm, bool paced = true);
  ~ArmMotion();  // what still moves comes to rest
  ArmMotion(const ArmMotion&) = delete;

  // --- one thread, not the loop's ---
  // Have the records come to `since`, and is the controllet that is active by now in them? After a switch, or
  // on a full machine, it takes a moment, and what they showed before may be long gone.
  bool ready(Quantity quantity, HostTime since) const;
  // All throw MotionRefused (then nothing has changed), or take the listener. They plan: milliseconds.
  void through_joints(std::span<const JointVector> via, double scale,
                      std::shared_ptr<MotionListener> listener);
  void through_poses(std::span<const ViaPose> via, double scale, std::shared_ptr<MotionListener> listener);
  void follow(const TrajectoryGoal& goal, std::shared_ptr<MotionListener> listener);
  // Brakes to rest, if it is this one's motion that runs; its over() comes when it is at rest.
  bool cancel(const MotionListener& listener);

  // --- publisher's thread ---
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
    MotionEnd end = MotionEnd::reached;  // when it is at rest
    std::string why;
    std::int64_t last_progress = kNow;
  };
  static constexpr std::int64_t kNow = -1;

  Input find_input(Quantity quantity) const;  // throws MotionRefused
  std::optional<Input> active_input(Quantity quantity) const;
  const InputSpec& spec(const Input& input) const;
  JointMotionLimits joint_limits(const Input& input) const;
  PoseMotionLimits pose_limits(const Input& input) const;
  void check_joints(const JointVector& q) const;
  void check_trajectory(const JointMotion& motion, const Input& input) const;
  void begin(Quantity quantity, const std::function<Motion(const Start&, const Input&)>& plan,
             TrajectoryGoal watch, std::shared_ptr<MotionListener> listener);

  // With mutex_
  const ReferenceSample* latest(const Input& input) const;
  Start start_of(const Input& input) const;
  void brake(Run& run, MotionEnd end, std::string why);
  void end(MotionEnd end, const std::string& why);
  bool watch_path(Run& run, const ArmSample& arm, double t);
  bool post(const Run& run, double t, Delivery delivery);
  std::int64_t behind(const CycleRecord& record) const;
  void tell(Run& run, const ArmSample& arm, double t);
  void settle(Run& run, const ArmSample& arm, double t);
  double off_goal(const Run& run) const;

  const RunWorld& world_;
  const ArmIndex arm_;
  const std::size_t n_;
  const bool paced_;

  mutable std::mutex mutex_;
  std::deque<Run> runs_;   // the first one moves; the next one takes over at its t0
  std::int64_t t_ = kNow;  // the loop's time, as far as the newest record tells
  // Of the newest record
  HostTime start_;
  std::vector<ReferenceSample> references_;  // of this arm's instances
};

}  // namespace multipanda::ros
