#pragma once

#include <array>

#include "backends/simulated_arm/measured_limits.hpp"

namespace multipanda {

// Joint motion to successive targets, planned by the arm itself, with limited velocity, acceleration and
// jerk. It ends at rest and accepts a new target at any time. It shares no code with Reference, which plans
// commands to an arm: the simulated arm would otherwise hide faults of that code.
//
// Each joint brings its acceleration to zero, changes to a cruising velocity, cruises, and brakes to rest.
// Changes of velocity use the jerk limit and, if long enough, the acceleration limit. The slowest joint sets
// the duration; from rest all joints arrive together. In motion, a joint that would have to reverse to take
// as long as the others arrives earlier. A joint that cannot stop before its target passes it and returns.
//
// No allocation, no lock; set_target takes a few microseconds, step less than one.
class AsyncPlanner {
 public:
  explicit AsyncPlanner(MotionLimits limits);

  // At rest in q. dq_max (n x 1) [rad/s]: positive; limited to the arm's own limits.
  void start(const JointVector& q, const JointVector& dq_max);
  // Setting the current target again has no effect. The caller has checked the position limits.
  void set_target(const JointVector& q);
  // Stops as soon as the limits allow.
  void stop();

  // One period of 1 ms.
  void step();

  const JointVector& q() const { return q_; }      // [rad]
  const JointVector& dq() const { return dq_; }    // backward differences, as published [rad/s]
  const JointVector& ddq() const { return ddq_; }  // [rad/s^2]
  const JointVector& target() const { return target_; }
  bool at_rest() const { return period_ >= periods_; }  // arrived, or no motion yet

 private:
  // Constant jerk for `duration`.
  struct Piece {
    double duration = 0, jerk = 0;
  };
  // One joint's motion: pieces in order, from a state.
  struct Way {
    static constexpr int kMost = 8;
    double q0 = 0, v0 = 0, a0 = 0;
    std::array<Piece, kMost> pieces{};
    int count = 0;
    double duration = 0, q_end = 0;
  };
  struct State {
    double q, v, a;
  };
  struct Approach {  // from constant velocity v0 to rest at distance d, over the cruising velocity vc
    double cruise = 0, cruise_time = 0, duration = 0;
  };
  static State at(const Way& way, double t);
  double change_time(Eigen::Index joint, double dv) const;
  Approach approach(Eigen::Index joint, double v0, double d, double vc) const;
  Approach fastest(Eigen::Index joint, double v0, double d) const;
  Approach slower(Eigen::Index joint, double v0, double d, const Approach& fast, double duration) const;
  void add(Way& way, double duration, double jerk) const;
  void add_change(Way& way, Eigen::Index joint, double dv) const;
  double calm(Way& way, Eigen::Index joint, const State& now, double& distance) const;
  void begin();

  MotionLimits limits_;
  JointVector dq_max_, target_, q_, dq_, ddq_;
  std::array<Way, kMaxJoints> ways_;
  std::int64_t period_ = 0, periods_ = 0;
};

}  // namespace multipanda
