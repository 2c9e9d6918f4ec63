#include <algorithm>
#include <cmath>
#include <utility>

#include "core/reference/reference.hpp"
#include "core/types/carriage_speed.hpp"
#include "core/types/spatial.hpp"

// The pace at which a set-point moves along its path: slower if the hand would be too fast, and zero while
// the hand cannot follow.
namespace multipanda {
namespace {

// The pace follows what is desired as a critically damped second order, so that the acceleration of the
// set-point stays continuous and a stop from 0.25 m/s adds at most 0.25 kPaceBandwidth / e = 2.8 m/s^2.
constexpr double kPaceBandwidth = 30;  // [rad/s]
// Look-ahead along the path for the speed of the hand; the pace needs about that long to settle.
constexpr double kLookAhead = 0.1;  // [s]

double dot(const QuinticSegment::Values& a, const QuinticSegment::Values& b, std::size_t first,
           std::size_t end) {
  double sum = 0;
  for (std::size_t i = first; i < end; ++i) sum += a[i] * b[i];
  return sum;
}

// Speed of a point that moves with the hand, p from its origin.
double speed_at(const Vector3& v, const Vector3& omega, const Vector3& p) {
  return (v + omega.cross(p)).norm();
}

}  // namespace

void Reference::bound_hand_speed(double greatest, const Jacobian& J) {
  greatest_hand_speed_ = greatest;
  if (J.allFinite()) J_hand_ = J;
}

void Reference::bound_carried_speed(const Jacobian& J) {
  if (J.allFinite()) J_carried_ = J;
}

void Reference::bound_hand_speed(double greatest, double lever) {
  greatest_hand_speed_ = greatest;
  if (std::isfinite(lever)) lever_ = lever;
}

void Reference::bound_points(double greatest, std::span<const Vector3> from_hand, double farthest) {
  greatest_of_points_ = greatest;
  if (!std::ranges::all_of(from_hand, [](const Vector3& p) { return p.allFinite(); })) return;
  point_count_ = std::min(from_hand.size(), points_.size());
  std::copy_n(from_hand.begin(), point_count_, points_.begin());
  farthest_ = farthest;
}

// Each hand separately: an object between two hands pulls them in opposite directions, and the set-point
// waits for the hand that it would load more.
void Reference::add_resistance(const Resistance& hand) {
  const auto share = [](const Resistance& r) { return std::max(r.force_share, r.moment_share); };
  if (resisting_count_ < resisting_.size()) {
    resisting_[resisting_count_++] = hand;
    return;
  }
  Resistance& weakest = *std::min_element(resisting_.begin(), resisting_.end(),
                                          [&](const auto& a, const auto& b) { return share(a) < share(b); });
  if (share(hand) > share(weakest)) weakest = hand;
}

void Reference::resist(const Vector6& pull, double force_share, double moment_share) {
  Resistance hand{.pull = {}, .force_share = force_share, .moment_share = moment_share};
  std::copy_n(pull.data(), 6, hand.pull.begin());
  add_resistance(hand);
}

void Reference::resist(const JointVector& pull, double share) {
  Resistance hand{.pull = {}, .force_share = share, .moment_share = 0};
  std::copy_n(pull.data(), std::min(size_, static_cast<std::size_t>(pull.size())), hand.pull.begin());
  add_resistance(hand);
}

double Reference::largest_share() const {
  double share = 0;
  for (std::size_t i = 0; i < resisting_count_; ++i)
    share = std::max({share, resisting_[i].force_share, resisting_[i].moment_share});
  return share;
}

// The share of the pull that grows if the set-point moves along `velocity`.
double Reference::share_along(const QuinticSegment::Values& velocity) const {
  const bool pose = spec_.quantity == Quantity::pose;
  double share = 0;
  for (std::size_t i = 0; i < resisting_count_; ++i) {
    const Resistance& hand = resisting_[i];
    if (dot(hand.pull, velocity, 0, pose ? 3 : size_) > 0) share = std::max(share, hand.force_share);
    if (pose && dot(hand.pull, velocity, 3, 6) > 0) share = std::max(share, hand.moment_share);
  }
  return share;
}

bool Reference::must_wait(const Target& target, double from_share) const {
  if (largest_share() < from_share) return false;
  QuinticSegment::Values way{};
  const auto& v = target.values;
  if (spec_.quantity == Quantity::pose) {
    for (std::size_t i = 0; i < 3; ++i) way[i] = v[i] - X_d_.position[static_cast<Eigen::Index>(i)];
    const Vector3 turn = log_rotation(Pose::from(v.data()).rotation * X_d_.rotation.transpose());
    for (std::size_t i = 0; i < 3; ++i) way[3 + i] = turn[static_cast<Eigen::Index>(i)];
  } else {
    for (std::size_t i = 0; i < size_; ++i) way[i] = v[i] - now_.position[i];
  }
  return share_along(way) >= from_share;
}

// Whether a new target has to wait; if so, the set-point brakes and the target is kept.
bool Reference::waits_for(const Target& target) {
  if (!must_wait(target, waiting_ ? kWaitsFrom : 1.0)) {
    waiting_ = false;
    return false;
  }
  if (!waiting_) plan_brake();
  waiting_ = true;
  waiting_for_ = target;
  return true;
}

// Speed of the hand, or of a faster carriage, for a velocity in the coordinates of the segment; 0
// if unbounded.
double Reference::hand_speed(const QuinticSegment::Values& velocity) const {
  if (!std::isfinite(greatest_hand_speed_)) return 0;
  if (spec_.quantity == Quantity::pose) {
    return Vector3(velocity[0], velocity[1], velocity[2]).norm() + lever_ * rotation_of(velocity).norm();
  }
  if (spec_.quantity != Quantity::joints || J_hand_.cols() != static_cast<Eigen::Index>(size_)) return 0;
  const auto twist = [&](const Jacobian& J) {
    Vector6 V = Vector6::Zero();
    for (Eigen::Index i = 0; i < J.cols(); ++i) V += J.col(i) * velocity[static_cast<std::size_t>(i)];
    return V;
  };
  const Vector6 V = twist(J_hand_);
  double fastest = std::max(V.head<3>().norm(), carriage_speed(J_hand_, std::span(velocity).first(size_)));
  for (const Vector3& p : std::span(points_).first(point_count_))
    fastest = std::max(fastest, speed_at(V.head<3>(), V.tail<3>(), p));
  if (J_carried_.cols() != J_hand_.cols()) return fastest;
  return std::max(fastest, twist(J_carried_).head<3>().norm());
}

// For plans. The motion of an arm's base may use up the speed of its hand; then the pace is zero, but a plan
// needs a duration.
double Reference::hand_bound() const {
  constexpr double kSlowest = 0.01;  // [m/s]
  return std::max(greatest_hand_speed_, kSlowest);
}

// For a pose: the speed that its position may have, at least the bound, over that of the fastest point; at
// most 1.
double Reference::points_share(const QuinticSegment::Sample& sample) const {
  if (spec_.quantity != Quantity::pose || !std::isfinite(greatest_of_points_)) return 1;
  const Vector3 dr = rotation_of(sample.velocity);
  const Vector3 v(sample.velocity[0], sample.velocity[1], sample.velocity[2]);
  if (v.norm() + dr.norm() * (lever_ + farthest_) <= greatest_of_points_) return 1;  // |omega| <= |dr|
  const Vector3 r = rotation_of(sample.position), omega = left_jacobian(r) * dr;
  const Matrix3 R = exp_rotation(r) * R_0_;
  double fastest = lever_ > 0 ? v.norm() + omega.norm() * (lever_ + farthest_) : 0;
  for (const Vector3& p : std::span(points_).first(point_count_))
    fastest = std::max(fastest, speed_at(v, omega, R * p));
  return std::min(1.0, std::max(greatest_of_points_, v.norm()) / fastest);
}

double Reference::desired_pace() const {
  double desired = std::clamp((1.0 - share_along(path_velocity_)) / (1.0 - kWaitsFrom), 0.0, 1.0);
  if (!std::isfinite(greatest_hand_speed_) && !std::isfinite(greatest_of_points_)) return desired;
  for (const double ahead : {0.0, 0.5 * kLookAhead, kLookAhead}) {
    QuinticSegment::Sample s;
    segment_.evaluate(t_ + ahead, s);
    if (in_motion_) motion_.add(t_motion_ + ahead, coordinates(), s);
    const double speed = hand_speed(s.velocity);
    if (speed > greatest_hand_speed_) desired = std::min(desired, greatest_hand_speed_ / speed);
    desired = std::min(desired, points_share(s));
  }
  return desired;
}

void Reference::update_pace(double dt) {
  const double desired = std::exchange(slowed_, 1.0) * desired_pace();
  resisting_count_ = 0;
  if (desired >= 1 && pace_ >= 1) return;
  pace_rate_ += dt * kPaceBandwidth * (kPaceBandwidth * (desired - pace_) - 2 * pace_rate_);
  pace_ += dt * pace_rate_;
  const bool arrived = desired >= 1 && pace_ > 1 - 1e-6;
  if (pace_ >= 1 || arrived) {
    pace_ = 1;
    pace_rate_ = 0;
  } else if (pace_ <= 0) {
    pace_ = 0;
    pace_rate_ = std::max(0.0, pace_rate_);
  }
}

// From derivatives by the time of the segment to derivatives by the time of the loop.
void Reference::apply_pace() {
  path_velocity_ = now_.velocity;
  if (pace_ >= 1 && pace_rate_ == 0) return;
  for (std::size_t i = 0; i < coordinates(); ++i) {
    now_.acceleration[i] = pace_ * pace_ * now_.acceleration[i] + pace_rate_ * now_.velocity[i];
    now_.velocity[i] *= pace_;
  }
}

}  // namespace multipanda
