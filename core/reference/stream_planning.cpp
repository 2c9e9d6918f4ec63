#include <algorithm>
#include <cmath>
#include <limits>

#include "core/reference/reference.hpp"
#include "core/types/spatial.hpp"

// Plans motions through the samples of a stream, and the stop at its end.
namespace multipanda {
namespace {

// A stream is planned at least this far ahead, so that replanning every millisecond stays smooth.
constexpr double kStreamHorizon = 0.005;
// Acceleration limits for uneven streams: a fraction of the arms' limits, so that the acceleration that a law
// feeds forward stays small.
constexpr double kCatchUpAcceleration = 2.0;         // [m/s^2]
constexpr double kCatchUpAngularAcceleration = 6.0;  // [rad/s^2]
constexpr double kLongestHorizon = 0.25;             // [s]
constexpr double kStreamExcess = 1.05;  // factor on the speed limit, to catch up with a stream at the limit
constexpr double kPeriodFilter = 0.1;   // weight of a new measurement in the stream's period
// Streams of poses and joints that are slower than this are followed along their estimated series.
constexpr double kSlowPeriod = 0.005;  // [s]
// A slow stream is planned this far ahead, so that two samples may be lost in a row, but no farther than
// kFarthest beyond the newest sample.
constexpr double kSlowHorizonPeriods = 3.5;
constexpr double kShortestSlowHorizon = 0.08;  // [s]
constexpr double kFarthest = 0.15;             // [s]
// Unevenness d of a series of speed v is compensated with a jerk of at most about v / kUnevenTime^2: the
// quintic that corrects an error d v within a horizon h begins with a jerk of 60 d v / h^3.
constexpr double kUnevenTime = 0.2;  // [s]

}  // namespace

// Passes the new sample one period from now, with the velocity of the series, and plans on to the horizon
// behind it. If the sample is far away (after a jump or at the beginning), it is treated as a goal, because
// speed limits have priority.
void Reference::plan_stream(const Target& target, std::uint64_t steps, double elapsed_s) {
  // Lost samples leave a gap in time, not in the numbering.
  if (period_s_ > 0) steps = std::max(steps, static_cast<std::uint64_t>(std::llround(elapsed_s / period_s_)));
  const double measured = elapsed_s / static_cast<double>(steps);
  const bool pose = spec_.quantity == Quantity::pose, begins = period_s_ == 0;
  period_s_ = period_s_ > 0 ? period_s_ + kPeriodFilter * (measured - period_s_) : measured;
  // A brake is finished first. Interrupted halfway, with its deceleration, the path to rest at a far sample
  // would go back at first, and each sample would begin it again. Its time continues while the set-point
  // waits for a hand, so that a sample that relieves the hand is soon followed.
  braking_s_ -= elapsed_s;
  const bool stopping = braking_s_ > 0;
  if (!stopping) rebase();
  if (pose || spec_.quantity == Quantity::joints) {
    if (begins) series_.begin(last_, pose, spec_.max_speed, spec_.max_angular_speed);
    series_.add(target, elapsed_s, period_s_, timed_);
    if (period_s_ >= kSlowPeriod && !stopping) return plan_slow_stream(target);
  }
  if (stopping) return;
  const Aim sample = aim_at(target);
  const double span = static_cast<double>(steps) * period_s_;
  // An early or late sample is a small jump of the series. A longer horizon catches up with it
  // at low acceleration.
  double horizon = std::max(kStreamHorizon, 1.5 * period_s_);
  for (;; horizon *= 1.5) {
    const Aim aim = aim_past(target, sample, span, horizon - period_s_);
    segment_.plan(coordinates(), now_, aim.goal, horizon, aim.velocity);
    if (horizon > kLongestHorizon || gentle(8)) break;
  }
  moving_end_ = true;
  if (too_fast()) plan_to_rest_or_brake(target);
}

// As plan_stream(), with velocity and acceleration of the estimated series: a slow series is smooth only if
// its acceleration continues, too. The horizon reaches beyond the next sample, so that one that is late or
// lost does not interrupt the motion, and farther if samples arrive unevenly.
void Reference::plan_slow_stream(const Target& target) {
  const double even =
      std::min(std::max(kSlowHorizonPeriods * period_s_, kShortestSlowHorizon), period_s_ + kFarthest);
  const double uneven = std::cbrt(60 * series_.unevenness() * kUnevenTime * kUnevenTime);
  double horizon = std::max(even, std::min(uneven, kLongestHorizon));
  for (;; horizon *= 1.25) {
    QuinticSegment::Sample end = series_.at(horizon - period_s_, R_0_);
    if (speed_excess(end) > 1) {  // goes on from the sample at the limit
      end = series_.at(0, R_0_);
      const double keep = 1 / std::max(1.0, speed_excess(end));
      for (std::size_t i = 0; i < coordinates(); ++i) {
        end.velocity[i] *= keep;
        end.position[i] += end.velocity[i] * (horizon - period_s_);
      }
      end.acceleration = {};
    }
    segment_.plan(coordinates(), now_, end.position, horizon, end.velocity, end.acceleration);
    if (horizon > kLongestHorizon || gentle(8, end.acceleration)) break;
  }
  moving_end_ = true;
  if (too_fast()) plan_to_rest_or_brake(target);
}

// To rest at a sample that is too far away to be passed in time. If that, too, needs a speed above its limit,
// because the set-point moves the wrong way, it brakes first: otherwise each sample would raise the speed
// that the next one accepts.
void Reference::plan_to_rest_or_brake(const Target& target) {
  const Aim sample = aim_at(target);
  if (plan_rest(sample.goal, sample.shortest_s, goal_acceleration()) <= 1) return;
  plan_brake();
  braking_s_ = kBrakingTime;
}

// Whether the planned segment exceeds the speed limit, or grows faster than it is now.
bool Reference::too_fast() const {
  return peak_excess(8) > (speed_excess(now_) > kStreamExcess ? 1 : kStreamExcess);
}

// The largest share of the limits that the velocity of a sample uses; for the limits of its points at
// least 1.
double Reference::speed_excess(const QuinticSegment::Sample& sample) const {
  const Magnitude speed = magnitude(sample.velocity);
  return std::max({speed.linear / spec_.max_speed, speed.angular / spec_.max_angular_speed,
                   hand_speed(sample.velocity) / hand_bound(), 1 / points_share(sample)});
}

// Extrapolates the series to `ahead` seconds after the sample.
Reference::Aim Reference::aim_past(const Target& target, const Aim& sample, double span, double ahead) const {
  Aim aim = sample;
  const bool pose = spec_.quantity == Quantity::pose;
  const std::size_t n = pose ? 3 : size_;
  double speed2 = 0;  // of a pose's position; otherwise of the fastest coordinate
  for (std::size_t i = 0; i < n; ++i) {
    aim.velocity[i] = (target.values[i] - last_.values[i]) / span;
    const double square = aim.velocity[i] * aim.velocity[i];
    speed2 = pose ? speed2 + square : std::max(speed2, square);
  }
  const double hand = pose ? 0.0 : hand_speed(aim.velocity);
  const double keep = std::min(speed2 > 0 ? std::min(1.0, spec_.max_speed / std::sqrt(speed2)) : 1.0,
                               hand > 0 ? std::min(1.0, greatest_hand_speed_ / hand) : 1.0);
  for (std::size_t i = 0; i < n; ++i) aim.velocity[i] *= keep;
  const auto go_on = [&] {
    for (std::size_t i = 0; i < n; ++i) aim.goal[i] += aim.velocity[i] * ahead;
  };
  if (!pose) return go_on(), aim;
  const Matrix3 R = Pose::from(target.values.data()).rotation;
  const Matrix3 R_last = Pose::from(last_.values.data()).rotation;
  Vector3 omega = log_rotation(R * R_last.transpose()) / span;
  if (omega.norm() > spec_.max_angular_speed) omega *= spec_.max_angular_speed / omega.norm();
  // First order of the inverse left Jacobian: r stays small within the horizon.
  const auto turn = [&](const Vector3& r) {
    const Vector3 dr = omega - 0.5 * r.cross(omega);
    for (std::size_t i = 0; i < 3; ++i) {
      aim.goal[3 + i] = r[static_cast<Eigen::Index>(i)];
      aim.velocity[3 + i] = dr[static_cast<Eigen::Index>(i)];
    }
  };
  turn(rotation_of(aim.goal));
  const double share = points_share({aim.goal, aim.velocity, {}});
  omega *= share;
  for (std::size_t i = 0; i < n; ++i) aim.velocity[i] *= share;
  go_on();
  turn(log_rotation(exp_rotation(omega * ahead) * R * R_0_.transpose()));
  return aim;
}

// Returns whether the planned segment keeps to the acceleration limits for catching up (or to the present
// acceleration, if that is higher). A series that itself accelerates strongly may be caught up with at twice
// its acceleration, but at no more than twice the limit.
bool Reference::gentle(std::size_t samples, const QuinticSegment::Values& own) const {
  if (spec_.quantity != Quantity::pose && spec_.quantity != Quantity::joints) return true;
  QuinticSegment::Sample s;
  for (std::size_t k = 1; k < samples; ++k) {
    segment_.evaluate(segment_.duration() * static_cast<double>(k) / static_cast<double>(samples), s);
    for (std::size_t i = 0; i < coordinates(); ++i) {
      const bool linear = spec_.quantity == Quantity::pose && i < 3;
      const double limit = linear ? kCatchUpAcceleration : kCatchUpAngularAcceleration;
      const double allowed =
          std::max({limit, std::abs(now_.acceleration[i]), std::min(2 * std::abs(own[i]), 2 * limit)});
      if (std::abs(s.acceleration[i]) > allowed) return false;
    }
  }
  return true;
}

// From the current motion to rest, at the end point of a constant deceleration.
void Reference::plan_brake() {
  rebase_to_rest();
  QuinticSegment::Values goal = now_.position;
  for (std::size_t i = 0; i < coordinates(); ++i) goal[i] += 0.5 * kBrakingTime * now_.velocity[i];
  segment_.plan(coordinates(), now_, goal, kBrakingTime);
  moving_end_ = false;
}

}  // namespace multipanda
