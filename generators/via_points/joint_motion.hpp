#pragma once

#include <optional>
#include <span>
#include <vector>

#include "generators/via_points/quintic_piece.hpp"

// Motions of joints, planned as a whole before they begin. Whoever streams them takes sample(t) at its own
// rate. Everything here throws std::invalid_argument, with what was expected, for what cannot be planned.
namespace multipanda {

// Magnitudes that a motion stays within, above 0, (n x 1) each.
struct JointMotionLimits {
  JointVector velocity;      // [rad/s]
  JointVector acceleration;  // [rad/s^2]
  JointVector jerk;          // [rad/s^3]
};

// A motion of n joints from t = 0 to duration(). A value: copy it, pass it to other threads.
class JointMotion {
 public:
  // At rest, of no duration.
  explicit JointMotion(const JointVector& rest);
  // `knots`: when the via points are passed [s].
  JointMotion(const JointVector& start, std::vector<QuinticPiece> pieces, std::vector<double> knots);

  std::size_t size() const { return static_cast<std::size_t>(end_.size()); }  // joints
  double duration() const { return starts_.back(); }                          // [s]

  // At t [s] since the start; before it and after the end the motion rests. Does not allocate.
  JointSample sample(double t) const;

  // One time per via point, in their order [s].
  const std::vector<double>& knots() const { return knots_; }
  // Exact extremes of all pieces; lowest and highest position include both ends.
  JointPeaks peaks() const;
  const std::vector<QuinticPiece>& pieces() const { return pieces_; }

 private:
  JointVector start_, end_;
  std::vector<QuinticPiece> pieces_;
  std::vector<double> starts_;  // of the pieces, and the end [s]
  std::vector<double> knots_;
};

// Through every via point without a stop, to rest at the last one. Position, velocity and acceleration are
// continuous (quintic pieces). Between rests a joint never leaves the interval between two successive via
// points, so a motion between allowed positions is allowed; where a joint turns round it stands for a moment.
// Within `scale` (0 < scale
// <= 1) times the limits. One via point is the motion of least jerk between rests. A start that moves is
// braked to rest first; via points equal to the one before take no time.
JointMotion joint_via_motion(const JointSample& start, std::span<const JointVector> via,
                             const JointMotionLimits& limits, double scale = 1);

// A smooth stop within `scale` times the limits of acceleration and jerk, each joint as soon as it can. Speed
// only grows where a start's acceleration leaves no choice.
JointMotion joint_brake(const JointSample& from, const JointMotionLimits& limits, double scale = 1);

// As FollowJointTrajectory gives it. Vectors of size 0: not given.
struct TrajectoryPoint {
  double time_s = 0;  // since the start
  JointVector position, velocity, acceleration;
};

// Through sampled points: quintic where both ends of a piece have velocity and acceleration, cubic where both
// have velocity, else linear (whose velocity jumps from piece to piece). Every point is met at its time
// exactly. Times ascend; with `start` they are above 0 and the motion begins there, as a point of time 0 with
// whatever the first point has; without it the first point has time 0. All points have the same number of
// joints. No limits: ask peaks().
JointMotion joint_trajectory(std::span<const TrajectoryPoint> points,
                             const std::optional<JointSample>& start = {});

}  // namespace multipanda
