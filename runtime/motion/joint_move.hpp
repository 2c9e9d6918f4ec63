#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "scene/scene.hpp"

// Slow motions of whole arms to a configuration, in separate sessions: for `multipanda move`, and to the
// start of an experiment.
namespace multipanda {

// A straight minimum-jerk motion in joint space, with its own joint_impedance.
struct JointMove {
  static constexpr double kLargestSpeed = 0.2;    // fraction of the joints' velocity limits
  static constexpr double kTolerance_rad = 0.02;  // of every joint at the end; of a prismatic one 0.02 m
  static constexpr double kSettle_s = 1.0;        // after the motion, before the result is evaluated

  ArmIndex arm = 0;
  JointVector from, goal;    // [rad] (n x 1)
  double slowest_joint = 0;  // velocity limit of the slowest joint [rad/s]
  double duration_s = 0;
  double hand_way = 0;  // largest motion of the hand or a carriage per share of the path [m]

  // Every joint stays below `speed`, a fraction of the slowest joint's limit, and the hand and bodies moved
  // by prismatic joints below `hand_speed` [m/s]. Off the loop: evaluates the arm's model along the path.
  void plan(const JointVector& start, double speed, const SceneArm& scene_arm, double hand_speed);

  double largest_way() const { return (goal - from).cwiseAbs().maxCoeff(); }  // of a joint [rad], [m]
  double joint_speed() const;                                                 // highest [rad/s]
  double hand_speed() const;                                                  // highest [m/s]
};

// The name of the controllet that moves an arm.
std::string move_controllet(const SceneArm& arm);
// Adds it to the scene, initially active, with the scene's bounds for contact. It starts at the
// measured configuration.
JointMove add_joint_move(Scene& scene, ArmIndex arm, JointVector goal);

// The measured configurations during a run. take(): one thread; the rest: any thread.
class MeasuredJoints {
 public:
  explicit MeasuredJoints(std::size_t arms) : q_(arms) {}

  void take(const CycleRecord& record);
  std::vector<JointArray> q() const;
  JointVector q(const JointMove& move) const;  // of its arm, (n x 1)
  double t() const;                            // loop time [s]
  // Waits until every arm has reported its configuration, or for the given time [s]. Returns false if
  // `stopped`, polled about 20 times per second, was true first.
  bool wait_for_all(const std::function<bool()>& stopped);
  bool wait_until(double t_s, const std::function<bool()>& stopped);

 private:
  template <typename Holds>
  bool wait(Holds holds, const std::function<bool()>& stopped);

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<JointArray> q_;
  double t_ = 0;
  bool seen_ = false;
};

}  // namespace multipanda
