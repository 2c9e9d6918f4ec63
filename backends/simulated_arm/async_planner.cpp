#include "backends/simulated_arm/async_planner.hpp"

#include <algorithm>
#include <cmath>

#include "core/types/time.hpp"

namespace multipanda {
namespace {

constexpr int kBisections = 60;  // to full precision
constexpr double kNothing = 1e-12;

}  // namespace

AsyncPlanner::AsyncPlanner(MotionLimits limits) : limits_(std::move(limits)) {
  q_ = dq_ = ddq_ = target_ = JointVector::Zero(limits_.dq_max.size());
  dq_max_ = limits_.dq_max;
}

void AsyncPlanner::start(const JointVector& q, const JointVector& dq_max) {
  q_ = target_ = q;
  dq_.setZero();
  ddq_.setZero();
  dq_max_ = dq_max.cwiseMin(limits_.dq_max);
  period_ = periods_ = 0;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    Way way;
    way.q0 = way.q_end = q[i];
    ways_[static_cast<std::size_t>(i)] = way;
  }
}

AsyncPlanner::State AsyncPlanner::at(const Way& way, double t) {
  if (t >= way.duration) return {way.q_end, 0, 0};
  State s{way.q0, way.v0, way.a0};
  for (int k = 0; k < way.count && t > 0; ++k) {
    const Piece& piece = way.pieces[static_cast<std::size_t>(k)];
    const double dt = std::min(t, piece.duration);
    s.q += dt * (s.v + dt * (s.a / 2 + dt * piece.jerk / 6));
    s.v += dt * (s.a + dt * piece.jerk / 2);
    s.a += dt * piece.jerk;
    t -= piece.duration;
  }
  return s;
}

// Duration of a change of velocity from and to zero acceleration. Its mean velocity is the mean of both ends.
double AsyncPlanner::change_time(Eigen::Index joint, double dv) const {
  const double a = limits_.ddq_max[joint], j = limits_.dddq_max[joint];
  dv = std::abs(dv);
  return dv >= a * a / j ? dv / a + a / j : 2 * std::sqrt(dv / j);
}

void AsyncPlanner::add(Way& way, double duration, double jerk) const {
  way.pieces[static_cast<std::size_t>(way.count++)] = {duration, jerk};
  way.duration += duration;
}

void AsyncPlanner::add_change(Way& way, Eigen::Index joint, double dv) const {
  const double a = limits_.ddq_max[joint], j = limits_.dddq_max[joint];
  const double ramp = std::abs(dv) >= a * a / j ? a / j : std::sqrt(std::abs(dv) / j);
  add(way, ramp, std::copysign(j, dv));
  add(way, std::max(0.0, change_time(joint, dv) - 2 * ramp), 0);
  add(way, ramp, -std::copysign(j, dv));
}

// Brings the acceleration to zero: the resulting velocity and the distance.
double AsyncPlanner::calm(Way& way, Eigen::Index joint, const State& now, double& distance) const {
  const double j = -std::copysign(limits_.dddq_max[joint], now.a);
  const double t = std::abs(now.a / j);
  add(way, t, j);
  distance = t * (now.v + t * (now.a / 2 + t * j / 6));
  return now.v + t * (now.a + t * j / 2);
}

// From constant velocity v0 to vc, cruising, then to rest. Without cruising the distance is
//   D(vc) = (v0 + vc)/2 T(vc - v0) + vc/2 T(vc),
// and cruising covers the rest of d. A negative cruising time means that vc is not possible.
AsyncPlanner::Approach AsyncPlanner::approach(Eigen::Index joint, double v0, double d, double vc) const {
  const double change = change_time(joint, vc - v0), brake = change_time(joint, vc);
  const double rest = d - 0.5 * (v0 + vc) * change - 0.5 * vc * brake;
  Approach a{.cruise = vc};
  a.cruise_time = std::abs(vc) < kNothing ? 0 : rest / vc;
  a.duration = change + a.cruise_time + brake;
  return a;
}

// D grows with vc >= max(v0, 0) from the stopping distance D(v0) = D(0) on; so the fastest motion cruises at
// the largest vc with D(vc) <= d within the velocity limit. Shorter distances are the mirrored case.
AsyncPlanner::Approach AsyncPlanner::fastest(Eigen::Index joint, double v0, double d) const {
  if (d < 0.5 * v0 * change_time(joint, v0)) {
    Approach mirrored = fastest(joint, -v0, -d);
    mirrored.cruise = -mirrored.cruise;
    return mirrored;
  }
  double low = std::max(v0, 0.0), high = std::max(dq_max_[joint], low);
  if (const Approach top = approach(joint, v0, d, high); top.cruise_time >= 0) return top;
  for (int k = 0; k < kBisections; ++k) {
    const double middle = 0.5 * (low + high);
    (approach(joint, v0, d, middle).cruise_time >= 0 ? low : high) = middle;
  }
  Approach best = approach(joint, v0, d, low);
  best.cruise_time = std::max(best.cruise_time, 0.0);
  return best;
}

// The duration grows without bound as the cruising velocity goes to zero (for cruising slower than the
// fastest motion).
AsyncPlanner::Approach AsyncPlanner::slower(Eigen::Index joint, double v0, double d, const Approach& fast,
                                            double duration) const {
  if (std::abs(fast.cruise) < kNothing || fast.duration >= duration) return fast;
  double low = 0, high = fast.cruise;
  for (int k = 0; k < kBisections; ++k) {
    const double middle = 0.5 * (low + high);
    (approach(joint, v0, d, middle).duration > duration ? low : high) = middle;
  }
  const Approach found = approach(joint, v0, d, high);
  return found.cruise_time >= 0 && found.duration <= duration + kArmPeriod ? found : fast;
}

void AsyncPlanner::set_target(const JointVector& q) {
  if (q == target_) return;
  const double now = static_cast<double>(period_) * kArmPeriod;
  std::array<double, kMaxJoints> v{}, d{};
  std::array<Approach, kMaxJoints> plan;
  double duration = 0;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const State state = at(ways_[k], now);
    Way way;
    way.q0 = state.q;
    way.v0 = state.v;
    way.a0 = state.a;
    double calmed = 0;
    v[k] = calm(way, i, state, calmed);
    d[k] = q[i] - state.q - calmed;
    plan[k] = fastest(i, v[k], d[k]);
    duration = std::max(duration, way.duration + plan[k].duration);
    way.q_end = q[i];
    ways_[k] = way;
  }
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    Way& way = ways_[k];
    const Approach a = slower(i, v[k], d[k], plan[k], duration - way.duration);
    add_change(way, i, a.cruise - v[k]);
    add(way, a.cruise_time, 0);
    add_change(way, i, -a.cruise);
  }
  target_ = q;
  begin();
}

void AsyncPlanner::stop() {
  const double now = static_cast<double>(period_) * kArmPeriod;
  for (Eigen::Index i = 0; i < q_.size(); ++i) {
    Way& old = ways_[static_cast<std::size_t>(i)];
    const State state = at(old, now);
    Way way;
    way.q0 = state.q;
    way.v0 = state.v;
    way.a0 = state.a;
    double calmed = 0;
    const double v = calm(way, i, state, calmed);
    add_change(way, i, -v);
    way.q_end = state.q + calmed + 0.5 * v * change_time(i, v);
    target_[i] = way.q_end;
    old = way;
  }
  begin();
}

void AsyncPlanner::begin() {
  double duration = 0;
  for (Eigen::Index i = 0; i < q_.size(); ++i) {
    duration = std::max(duration, ways_[static_cast<std::size_t>(i)].duration);
  }
  period_ = 0;
  // Two more periods, so that the backward differences are zero as well.
  periods_ = duration < kNothing ? 0 : static_cast<std::int64_t>(std::ceil(duration / kArmPeriod)) + 2;
}

void AsyncPlanner::step() {
  ++period_;
  const double now = static_cast<double>(period_) * kArmPeriod;
  for (Eigen::Index i = 0; i < q_.size(); ++i) {
    const double q = at(ways_[static_cast<std::size_t>(i)], now).q;
    const double dq = (q - q_[i]) / kArmPeriod;
    ddq_[i] = (dq - dq_[i]) / kArmPeriod;
    dq_[i] = dq;
    q_[i] = q;
  }
}

}  // namespace multipanda
