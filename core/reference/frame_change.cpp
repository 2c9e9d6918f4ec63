#include <algorithm>

#include "core/reference/reference.hpp"
#include "core/types/spatial.hpp"

// Moves a set-point along with a frame that was redefined.
namespace multipanda {
namespace {

// Motion of a frame fixed to another one, X away from it: position, velocity and acceleration of one rigid
// body at another point.
void move_along(const Pose& X, Pose& X_d, Twist& V, Twist& A) {
  const Vector3 r = X_d.rotation * X.position;
  const Vector3 omega = V.angular(), alpha = A.angular();
  X_d = X_d * X;
  V.linear() += omega.cross(r);
  A.linear() += alpha.cross(r) + omega.cross(omega.cross(r));
}

}  // namespace

void Reference::carry(const Pose& X) {
  if (spec_.quantity != Quantity::pose) return;
  // Only the segment is transformed: a motion on top of it moves only the position, in world axes, and stays.
  QuinticSegment::Sample base, end;
  segment_.evaluate(t_, base);
  segment_.evaluate(std::max(t_, segment_.duration()), end);
  Pose X_base, X_goal;
  Twist V, A, V_end, A_end;
  pose_of(base, X_base, V, A);
  pose_of(end, X_goal, V_end, A_end);
  move_along(X, X_base, V, A);
  X_goal = X_goal * X;

  const double left_s = segment_.duration() - t_;
  R_0_ = X_base.quaternion().normalized().toRotationMatrix();
  t_ = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    now_.position[i] = X_base.position[k];
    now_.position[3 + i] = 0;
    for (const std::size_t at : {std::size_t{0}, std::size_t{3}}) {
      now_.velocity[at + i] = V.vector[static_cast<Eigen::Index>(at + i)];
      now_.acceleration[at + i] = A.vector[static_cast<Eigen::Index>(at + i)];
    }
  }
  QuinticSegment::Values goal{};
  if (moving_end_) {  // a stream: its samples are of the old frame until its sender knows of the new one
    goal = now_.position;
    for (std::size_t i = 0; i < 6; ++i) goal[i] += 0.5 * kBrakingTime * now_.velocity[i];
  } else {
    const Vector3 turn = log_rotation(X_goal.rotation * R_0_.transpose());
    for (std::size_t i = 0; i < 3; ++i) {
      goal[i] = X_goal.position[static_cast<Eigen::Index>(i)];
      goal[3 + i] = turn[static_cast<Eigen::Index>(i)];
    }
  }
  if (left_s > 0 || moving_end_) {
    plan_rest(goal, moving_end_ ? kBrakingTime : left_s, goal_acceleration());
  } else {
    segment_.plan(coordinates(), now_, goal, 0);
  }
  // The next sample of a stream is not a continuation: it is approached within the speed limits.
  last_.id = kOfAnotherFrame;
  period_s_ = 0;
  forget_chunk();
  // The same for a goal that waits for the hand.
  if (waiting_ && waiting_for_.delivery == Delivery::goal) {
    waiting_for_.values = pose_target(Pose::from(waiting_for_.values.data()) * X).values;
  }
  if (in_motion_) motion_.add(t_motion_, coordinates(), now_);
  apply_pace();
  publish_sample();
}

}  // namespace multipanda
