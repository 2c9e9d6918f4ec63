#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/trajectory/quintic.hpp"

// Joint motions that are planned as a whole before they begin. The sender takes sample(t) at its own rate.
// All functions throw std::invalid_argument, with the expected input, if a motion cannot be planned.
namespace multipanda {

// Limits of a motion as magnitudes above 0, (n x 1) each.
struct JointMotionLimits {
  JointVector velocity;      // [rad/s]
  JointVector acceleration;  // [rad/s^2]
  JointVector jerk;          // [rad/s^3]
};

// A motion of n joints from t = 0 to duration(). A value: copy it, pass it to other threads.
class JointMotion {
 public:
  // A rest of zero duration.
  explicit JointMotion(const JointVector& rest);
  // `knots`: times at which the via points are passed [s].
  JointMotion(const JointVector& start, std::vector<QuinticPiece> pieces, std::vector<double> knots);

  std::size_t size() const { return static_cast<std::size_t>(end_.size()); }  // joints
  double duration() const { return starts_.back(); }                          // [s]

  // Sample at t [s] since the start. Before the start and after the end the motion rests. Does not allocate.
  JointSample sample(double t) const;

  // One time per via point, in their order [s].
  const std::vector<double>& knots() const { return knots_; }
  // Exact extremes of all pieces. Lowest and highest position include both ends.
  JointPeaks peaks() const;
  const std::vector<QuinticPiece>& pieces() const { return pieces_; }

 private:
  JointVector start_, end_;
  std::vector<QuinticPiece> pieces_;
  std::vector<double> starts_;  // of the pieces, and the end [s]
  std::vector<double> knots_;
};

// A motion through every via point without a stop, to rest at the last one, within `scale` (0 < scale <= 1)
// times the limits. Position, velocity and acceleration are continuous (quintic pieces). Between rests a
// joint never leaves the interval between two successive via points, so a motion between allowed positions is
// allowed. A joint that reverses is at rest for a moment. With one via point it is the minimum-jerk motion
// between rests. A moving start is braked to rest first. A via point equal to the one before takes no time.
JointMotion joint_via_motion(const JointSample& start, std::span<const JointVector> via,
                             const JointMotionLimits& limits, double scale = 1);

// A smooth stop within `scale` times the limits of acceleration and jerk, each joint as soon as it can. Speed
// grows only if the start's acceleration makes that unavoidable.
JointMotion joint_brake(const JointSample& from, const JointMotionLimits& limits, double scale = 1);

// A point of a FollowJointTrajectory goal. Vectors of size 0 are not given.
struct TrajectoryPoint {
  double time_s = 0;  // since the start
  JointVector position, velocity, acceleration;
};

// A motion through sampled points, each met exactly at its time. A piece is quintic if both of its ends have
// velocity and acceleration, cubic if both have velocity, otherwise linear (the velocity jumps between linear
// pieces). Times ascend, and all points have the same number of joints. With `start` the motion begins there
// at time 0, with the derivatives that the first point has, and all times are above 0. Without it the first
// point has time 0. No limits apply: check peaks().
JointMotion joint_trajectory(std::span<const TrajectoryPoint> points,
                             const std::optional<JointSample>& start = {});

}  // namespace multipanda
