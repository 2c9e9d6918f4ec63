#include "ros/adapter/compat/velocity_goal.hpp"

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "ros/adapter/compat/measured_arms.hpp"

namespace multipanda::ros {

JointVector VelocityGoal::next(const JointVector& dq, const JointVector& q, double age_s, HostTime now) {
  const bool again = started_ && seconds(now - last_) <= timeout_s_;
  if (seconds(now - heard_) > timeout_s_) ran_away_.reset();
  heard_ = now;
  started_ = false;
  if (!dq.allFinite()) throw std::invalid_argument("a number is not finite");
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    if (std::abs(dq[i]) > dq_max_[i]) {
      throw std::invalid_argument(
          fmt::format("joint {}: {:.4g} rad/s is above its limit, {:.4g} rad/s", i + 1, dq[i], dq_max_[i]));
    }
  }
  check_age(age_s);
  if (ran_away_ && ran_away_->side * dq[ran_away_->joint] > 0) {
    throw std::invalid_argument(fmt::format(
        "joint {} did not follow, and may push against something: send 0, a velocity in the other direction, "
        "or nothing for {:g} s",
        ran_away_->joint + 1, timeout_s_));
  }
  ran_away_.reset();
  JointVector q_d = q + kFirst * dq;
  for (Eigen::Index i = 0; again && i < dq.size(); ++i) {
    if (dq[i] != 0) {
      q_d[i] = q_d_[i] + seconds(now - last_) * dq[i];
    } else {
      q_d[i] = dq_[i] == 0 ? q_d_[i] : q[i];
    }
  }
  Eigen::Index farthest = 0;
  if (const double distance = (q_d - q).cwiseAbs().maxCoeff(&farthest); distance > kWindow) {
    ran_away_ = RanAway{farthest, q_d[farthest] > q[farthest] ? 1.0 : -1.0};
    throw std::invalid_argument(
        fmt::format("joint {}: its set-point is {:.4g} rad away from the arm, more than {:g}: the joint "
                    "moves slower than requested",
                    farthest + 1, distance, kWindow));
  }
  q_d_ = q_d;
  dq_ = dq;
  last_ = now;
  started_ = true;
  return q_d_;
}

}  // namespace multipanda::ros
