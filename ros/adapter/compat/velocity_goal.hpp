#pragma once

#include <optional>
#include <utility>

#include "core/types/joints.hpp"
#include "core/types/time.hpp"

namespace multipanda::ros {

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
