#include "core/trajectory/quintic.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace multipanda {
namespace {

double polynomial(std::span<const double> c, double t) {
  double value = 0;
  for (std::size_t k = c.size(); k-- > 0;) value = value * t + c[k];
  return value;
}

// Coefficients of a polynomial of at most degree five.
struct Coefficients {
  std::array<double, 6> c{};
  std::size_t count = 0;
  std::span<const double> span() const { return {c.data(), count}; }
};

Coefficients derivative(const Coefficients& p) {
  Coefficients d;
  d.count = p.count - 1;
  for (std::size_t k = 0; k < d.count; ++k) d.c[k] = static_cast<double>(k + 1) * p.c[k + 1];
  return d;
}

// The sign changes of p within (0, T), ascending. Between two zeros of its derivative p is monotone, so
// bisection finds every zero.
std::vector<double> sign_changes(const Coefficients& p, double T) {
  std::vector<double> zeros;
  if (p.count < 2) return zeros;
  std::vector<double> ends = sign_changes(derivative(p), T);
  ends.insert(ends.begin(), 0.0);
  ends.push_back(T);
  for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
    double low = ends[i], high = ends[i + 1];
    const double at_low = polynomial(p.span(), low);
    if (at_low * polynomial(p.span(), high) >= 0) continue;
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      (at_low * polynomial(p.span(), middle) > 0 ? low : high) = middle;
    }
    zeros.push_back(0.5 * (low + high));
  }
  return zeros;
}

struct Range {
  double lowest, highest;
  double magnitude() const { return std::max(-lowest, highest); }
};

Range range_of(const Coefficients& p, double T) {
  const double at_end = polynomial(p.span(), T);
  Range range{std::min(p.c[0], at_end), std::max(p.c[0], at_end)};
  for (const double t : sign_changes(derivative(p), T)) {
    const double value = polynomial(p.span(), t);
    range = {std::min(range.lowest, value), std::max(range.highest, value)};
  }
  return range;
}

// A phase of constant jerk on the way of one coordinate to a stop.
struct Phase {
  double duration, jerk;
};

std::vector<Phase> stopping_phases(double v, double a, double a_max, double j_max) {
  // The velocity that remains after the acceleration is brought to zero.
  const double rest = v + 0.5 * a * std::abs(a) / j_max;
  const double side = rest > 0 ? 1 : -1;
  const double w = side * v, b = -side * a;  // speed to lose, deceleration now
  // Raising the deceleration to `peak` and lowering it to zero takes away (2 peak^2 - b^2) / (2 j) of speed.
  double peak = std::sqrt(std::max(0.0, j_max * w + 0.5 * b * b)), hold = 0;
  const double ceiling = a_max;
  if (peak > ceiling) {
    peak = ceiling;
    const double rising = (peak * peak - b * b) / (2 * j_max) * (b > peak ? -1 : 1);
    hold = std::max(0.0, (w - rising - peak * peak / (2 * j_max)) / peak);
  }
  std::vector<Phase> phases;
  const auto add = [&](double duration, double jerk) {
    if (duration > 1e-9) phases.push_back({duration, jerk});
  };
  add(std::abs(peak - b) / j_max, (peak > b ? -side : side) * j_max);
  add(hold, 0);
  add(peak / j_max, side * j_max);
  return phases;
}

}  // namespace

Quintic Quintic::between(const State& from, const State& to, double duration_s) {
  const double T = duration_s, T2 = T * T, T3 = T2 * T, d = to.position - from.position;
  const double v0 = from.velocity, v1 = to.velocity, a0 = from.acceleration, a1 = to.acceleration;
  return {{from.position, v0, 0.5 * a0, (20 * d - (8 * v1 + 12 * v0) * T - (3 * a0 - a1) * T2) / (2 * T3),
           (-30 * d + (14 * v1 + 16 * v0) * T + (3 * a0 - 2 * a1) * T2) / (2 * T3 * T),
           (12 * d - 6 * (v1 + v0) * T + (a1 - a0) * T2) / (2 * T3 * T2)}};
}

Quintic::State Quintic::at(double t) const {
  return {c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5])))),
          c[1] + t * (2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5]))),
          2 * c[2] + t * (6 * c[3] + t * (12 * c[4] + t * 20 * c[5]))};
}

QuinticPiece QuinticPiece::between(const JointSample& from, const JointSample& to, double duration_s) {
  QuinticPiece piece{.duration = duration_s, .size = static_cast<std::size_t>(from.position.size())};
  for (Eigen::Index i = 0; i < from.position.size(); ++i) {
    piece.coordinates[static_cast<std::size_t>(i)] =
        Quintic::between({from.position[i], from.velocity[i], from.acceleration[i]},
                         {to.position[i], to.velocity[i], to.acceleration[i]}, duration_s);
  }
  return piece;
}

void QuinticPiece::evaluate(double t, JointSample& out) const {
  const auto n = static_cast<Eigen::Index>(size);
  out.position.resize(n);
  out.velocity.resize(n);
  out.acceleration.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Quintic::State s = coordinates[static_cast<std::size_t>(i)].at(t);
    out.position[i] = s.position;
    out.velocity[i] = s.velocity;
    out.acceleration[i] = s.acceleration;
  }
}

void QuinticSegment::plan(std::size_t size, const Sample& start, const Values& goal, double duration_s,
                          const Values& end_velocity, const Values& end_acceleration) {
  piece_.size = size;
  piece_.duration = duration_s > 0 ? duration_s : 0;
  goal_ = goal;
  if (piece_.duration == 0) return;
  for (std::size_t i = 0; i < size; ++i) {
    piece_.coordinates[i] =
        Quintic::between({start.position[i], start.velocity[i], start.acceleration[i]},
                         {goal[i], end_velocity[i], end_acceleration[i]}, piece_.duration);
  }
}

void QuinticSegment::evaluate(double t, Sample& out) const {
  for (std::size_t i = 0; i < piece_.size; ++i) {
    const Quintic::State s =
        t >= piece_.duration ? Quintic::State{.position = goal_[i]} : piece_.coordinates[i].at(t);
    out.position[i] = s.position;
    out.velocity[i] = s.velocity;
    out.acceleration[i] = s.acceleration;
  }
}

void JointPeaks::include(const JointPeaks& other) {
  lowest = lowest.cwiseMin(other.lowest).eval();
  highest = highest.cwiseMax(other.highest).eval();
  velocity = velocity.cwiseMax(other.velocity).eval();
  acceleration = acceleration.cwiseMax(other.acceleration).eval();
  jerk = jerk.cwiseMax(other.jerk).eval();
}

JointPeaks peaks_of(const QuinticPiece& piece) {
  const auto n = static_cast<Eigen::Index>(piece.size);
  JointPeaks peaks;
  for (JointVector* each : {&peaks.lowest, &peaks.highest, &peaks.velocity, &peaks.acceleration, &peaks.jerk})
    each->resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Coefficients position{.c = piece.coordinates[static_cast<std::size_t>(i)].c, .count = 6};
    const Coefficients velocity = derivative(position), acceleration = derivative(velocity);
    const Range range = range_of(position, piece.duration);
    peaks.lowest[i] = range.lowest;
    peaks.highest[i] = range.highest;
    peaks.velocity[i] = range_of(velocity, piece.duration).magnitude();
    peaks.acceleration[i] = range_of(acceleration, piece.duration).magnitude();
    peaks.jerk[i] = range_of(derivative(acceleration), piece.duration).magnitude();
  }
  return peaks;
}

std::vector<QuinticPiece> stopping_pieces(const JointSample& from, const JointVector& acceleration_limit,
                                          const JointVector& jerk_limit) {
  const auto n = from.position.size();
  std::vector<std::vector<Phase>> phases;
  std::vector<double> times{0.0};
  for (Eigen::Index i = 0; i < n; ++i) {
    phases.push_back(
        stopping_phases(from.velocity[i], from.acceleration[i], acceleration_limit[i], jerk_limit[i]));
    double t = 0;
    for (const auto& phase : phases.back()) times.push_back(t += phase.duration);
  }
  std::sort(times.begin(), times.end());
  std::vector<QuinticPiece> pieces;
  JointSample now = from;
  double t = 0;
  for (const double next : times) {
    if (next - t < 1e-9) continue;
    QuinticPiece piece{.duration = next - t, .size = static_cast<std::size_t>(n)};
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto& mine = phases[static_cast<std::size_t>(i)];
      double begin = 0, jerk = 0;
      bool done = true;
      for (const auto& phase : mine) {
        begin += phase.duration;
        if (0.5 * (t + next) < begin) {
          jerk = phase.jerk;
          done = false;
          break;
        }
      }
      if (done) now.velocity[i] = now.acceleration[i] = 0;  // removes rounding errors
      piece.coordinates[static_cast<std::size_t>(i)] = {
          {now.position[i], now.velocity[i], 0.5 * now.acceleration[i], jerk / 6}};
    }
    piece.evaluate(piece.duration, now);
    pieces.push_back(piece);
    t = next;
  }
  return pieces;
}

double stretch_for(double velocity_ratio, double acceleration_ratio, double jerk_ratio) {
  return std::max({velocity_ratio, std::sqrt(acceleration_ratio), std::cbrt(jerk_ratio)});
}

double rest_to_rest_duration(double distance, double velocity, double acceleration, double jerk) {
  return stretch_for(1.875 * distance / velocity, 10 / std::sqrt(3.0) * distance / acceleration,
                     60 * distance / jerk);
}

std::vector<double> shortest_durations(
    std::vector<double> first,
    const std::function<std::vector<double>(const std::vector<double>&)>& stretches) {
  constexpr int kRounds = 30;
  constexpr double kShare = 0.6;  // of the full correction: it also changes the neighbors' velocities
  std::vector<double> durations = std::move(first), best;
  double shortest = 0;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<double> stretch = stretches(durations);
    const double all = *std::max_element(stretch.begin(), stretch.end());
    double sum = 0;
    for (const double duration : durations) sum += all * duration;
    if (best.empty() || sum < shortest) {
      shortest = sum;
      best = durations;
      for (double& duration : best) duration *= all;
    }
    for (std::size_t k = 0; k < durations.size(); ++k) durations[k] *= std::pow(stretch[k], kShare);
  }
  return best;
}

}  // namespace multipanda
