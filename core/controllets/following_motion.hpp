#pragma once

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

// A set-point that follows a moving target, which a person guides: continuous in position, velocity and
// acceleration, within limits, whatever the target does. Loop thread, no allocation.
//
// With the velocity v_t of the target and the difference e from the set-point to it:
//   v_w = v_t + p/3 e,  a_w = p (v_w - v),  da/dt = 3 p (a_w - a)
// This is a triple pole at -p: the set-point does not lag behind a target of constant velocity, and by
// 3 a_t / p^2 (0.5 mm per m/s^2) behind one with the acceleration a_t. Far from the target, v_w is no faster
// than the set-point can brake. A Reference cannot do this: it plans segments to goals and to samples of
// streams, while a target that a person leads is known for this tick only.
namespace multipanda {

// Limits of the length of a vector, that of the coordinates first ... first + count - 1.
struct FollowingLimits {
  Eigen::Index first = 0, count = 0;
  double speed = 0, acceleration = 0, jerk = 0;  // [m/s, m/s^2, m/s^3] or [rad/s, ...]
};

// The pull of the set-point at the arm, and its share of the bound: bound_pull() bounds the torque of a tick,
// this holds back a set-point that would keep pulling. Both are smoothed, since a part of the pull is the
// set-point's own acceleration; otherwise the set-point would start and wait in turns.
class Resistance {
 public:
  static constexpr double kBandwidth = 30;  // [rad/s], as that of a reference's pace

  // Which part of the set-point's motion waits: the part along the pull, so that it slides across, or all of
  // it. Joints that continued across the pull would fold the arm.
  enum class Waits : std::uint8_t { along, all };

  void start(Eigen::Index coordinates, Waits waits = Waits::along);
  void update(const JointVector& pull, double share, double dt);
  // Remaining fraction of a motion that loads the arm: 1 up to a pull of 0.8 of the allowed one, 0 at the
  // full allowed pull.
  void hold_back(JointVector& motion) const;
  // The remaining distance to a target that goes back with this velocity: the set-point relieves the arm as
  // the target retreats, instead of catching up first. While the pull is small, it is the whole distance.
  void relieve(JointVector& way, const JointVector& target_velocity) const;
  Waits waits() const { return waits_; }

 private:
  JointVector pull_;
  double share_ = 0;
  Waits waits_ = Waits::along;
};

class FollowingMotion {
 public:
  static constexpr double kPole = 80;  // p [rad/s]

  void start(Eigen::Index coordinates);  // at rest
  // v_w of these coordinates, within their limits. `difference`: from the set-point, before this tick, to the
  // target in this tick. Along a pull that loads the arm, the set-point becomes slower from a share of 0.8 on
  // and waits at 1; across it, and back, it is free.
  JointVector desired(const JointVector& difference, const JointVector& target_velocity,
                      const FollowingLimits& limits, const Resistance& resistance, double dt) const;
  // `v_w`: of these coordinates only.
  void advance(const JointVector& v_w, const FollowingLimits& limits, double dt);

  bool rests() const;                                      // or almost
  void go(const JointVector& velocity) { v_ = velocity; }  // sets it; the acceleration stays
  const JointVector& velocity() const { return v_; }
  const JointVector& acceleration() const { return a_; }
  // The coordinates are those of a twist, about another point of the same body: p further, in the same axes.
  void carry(const Vector3& p);

 private:
  JointVector v_, a_;
};

}  // namespace multipanda
