#include "core/controllets/following_motion.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

constexpr double kWaitsFrom = 0.8;     // as references do (core/reference/reference.hpp)
constexpr double kBrakingShare = 0.6;  // of the acceleration, on the way to a distant target

void clamp_norm(JointVector& x, double most) {
  const double size = x.norm();
  if (size > most) x *= most / size;
}

}  // namespace

void Resistance::start(Eigen::Index coordinates, Waits waits) {
  waits_ = waits;
  pull_ = JointVector::Zero(coordinates);
  share_ = 0;
}

void Resistance::update(const JointVector& pull, double share, double dt) {
  const double weight = 1 - std::exp(-kBandwidth * dt);
  pull_ += weight * (pull - pull_);
  share_ += weight * (share - share_);
}

void Resistance::hold_back(JointVector& motion) const {
  const double size = pull_.norm();
  if (!(share_ > kWaitsFrom && size > 0)) return;
  const double along = pull_.dot(motion) / size;
  if (!(along > 0)) return;
  const double taken = std::min(1.0, (share_ - kWaitsFrom) / (1 - kWaitsFrom));
  if (waits_ == Waits::all) {
    motion *= 1 - taken;
  } else {
    motion -= taken * along / size * pull_;
  }
}

void Resistance::relieve(JointVector& way, const JointVector& target_velocity) const {
  constexpr double kLight = 0.3, kHard = 0.5;  // shares of the allowed pull
  constexpr double kGoes = 0.02;               // [m/s], [rad/s]
  const double size = pull_.norm();
  if (!(share_ > kLight && size > 0)) return;
  const double along = pull_.dot(way) / size, back = -pull_.dot(target_velocity) / size;
  if (!(along > 0 && back > 0)) return;
  const double taken = std::min(1.0, back / kGoes) * std::min(1.0, (share_ - kLight) / (kHard - kLight));
  if (waits_ == Waits::all) {
    way *= 1 - taken;
  } else {
    way -= taken * along / size * pull_;
  }
}

void FollowingMotion::start(Eigen::Index coordinates) { v_ = a_ = JointVector::Zero(coordinates); }

JointVector FollowingMotion::desired(const JointVector& difference, const JointVector& target_velocity,
                                     const FollowingLimits& limits, const Resistance& resistance,
                                     double dt) const {
  const auto part = [&](const JointVector& x) { return JointVector(x.segment(limits.first, limits.count)); };
  JointVector e = part(difference) - dt * part(v_), v = part(target_velocity);  // at the end of this tick
  clamp_norm(v, limits.speed);  // otherwise a velocity unrelated to the target's motion would carry it away
  resistance.relieve(e, v);
  if (resistance.waits() == Resistance::Waits::along) {
    // Computed first, because waiting along one direction must not reduce the speed across it.
    resistance.hold_back(e);
    resistance.hold_back(v);
  }
  // sqrt(2 a |e|): the highest speed from which it can brake to rest within |e|.
  const double linear = kPole / 3 * e.norm();
  const double brakes = std::sqrt(2 * kBrakingShare * limits.acceleration * e.norm());
  v += (linear > brakes ? brakes / linear : 1.0) * kPole / 3 * e;
  clamp_norm(v, limits.speed);
  resistance.hold_back(v);
  return v;
}

void FollowingMotion::advance(const JointVector& v_w, const FollowingLimits& limits, double dt) {
  auto v = v_.segment(limits.first, limits.count);
  auto a = a_.segment(limits.first, limits.count);
  JointVector a_w = kPole * (v_w - v);
  clamp_norm(a_w, limits.acceleration);
  JointVector j = 3 * kPole * (a_w - a);
  clamp_norm(j, limits.jerk);
  a += dt * j;
  v += dt * a;
}

bool FollowingMotion::rests() const {
  constexpr double kRests = 0.01;  // [m/s], [rad/s]
  return v_.norm() < kRests;
}

void FollowingMotion::carry(const Vector3& p) {
  const Vector3 omega = v_.segment<3>(3), alpha = a_.segment<3>(3);
  v_.head<3>() += omega.cross(p);
  a_.head<3>() += alpha.cross(p) + omega.cross(omega.cross(p));
}

}  // namespace multipanda
