#include <algorithm>
#include <cmath>
#include <limits>

#include "core/reference/reference.hpp"
#include "core/types/rotation_rate.hpp"

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
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

}  // namespace

// Passes the new sample one period from now, with the velocity of the series, and plans on to the horizon
// behind it. If the sample is far away (after a jump or at the beginning), it is treated as a goal, because
// speed limits have priority.
void Reference::plan_stream(const Target& target, std::uint64_t steps, double elapsed_s) {
  // Lost samples leave a gap in time, not in the numbering.
  if (period_s_ > 0) steps = std::max(steps, static_cast<std::uint64_t>(std::llround(elapsed_s / period_s_)));
  const double measured = elapsed_s / static_cast<double>(steps);
  period_s_ = period_s_ > 0 ? period_s_ + kPeriodFilter * (measured - period_s_) : measured;
  rebase();
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
  if (peak_excess(8) > kStreamExcess) plan_rest(sample.goal, sample.shortest_s, {kUnlimited, kUnlimited});
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
  for (std::size_t i = 0; i < n; ++i) {
    aim.velocity[i] *= keep;
    aim.goal[i] += aim.velocity[i] * ahead;
  }
  if (!pose) return aim;
  const auto& v = target.values;
  const auto& u = last_.values;
  const Matrix3 R = Quaternion(v[3], v[4], v[5], v[6]).normalized().toRotationMatrix();
  const Matrix3 R_last = Quaternion(u[3], u[4], u[5], u[6]).normalized().toRotationMatrix();
  Vector3 omega = log_rotation(R * R_last.transpose()) / span;
  if (omega.norm() > spec_.max_angular_speed) omega *= spec_.max_angular_speed / omega.norm();
  const Vector3 r = log_rotation(exp_rotation(omega * ahead) * R * R_0_.transpose());
  const Vector3 dr = omega - 0.5 * r.cross(omega);  // inverse left Jacobian, r small within a horizon
  for (std::size_t i = 0; i < 3; ++i) {
    aim.goal[3 + i] = r[static_cast<Eigen::Index>(i)];
    aim.velocity[3 + i] = dr[static_cast<Eigen::Index>(i)];
  }
  return aim;
}

// Returns whether the planned segment keeps to the acceleration limits for catching up (or to the present
// acceleration, if that is higher).
bool Reference::gentle(std::size_t samples) const {
  if (spec_.quantity != Quantity::pose && spec_.quantity != Quantity::joints) return true;
  QuinticSegment::Sample s;
  for (std::size_t k = 1; k < samples; ++k) {
    segment_.evaluate(segment_.duration() * static_cast<double>(k) / static_cast<double>(samples), s);
    for (std::size_t i = 0; i < coordinates(); ++i) {
      const bool linear = spec_.quantity == Quantity::pose && i < 3;
      const double limit = linear ? kCatchUpAcceleration : kCatchUpAngularAcceleration;
      if (std::abs(s.acceleration[i]) > std::max(limit, std::abs(now_.acceleration[i]))) return false;
    }
  }
  return true;
}

// From the current motion to rest, at the end point of a constant deceleration.
void Reference::plan_brake() {
  rebase();
  QuinticSegment::Values goal = now_.position;
  for (std::size_t i = 0; i < coordinates(); ++i) goal[i] += 0.5 * kBrakingTime * now_.velocity[i];
  segment_.plan(coordinates(), now_, goal, kBrakingTime);
  moving_end_ = false;
}

}  // namespace multipanda
