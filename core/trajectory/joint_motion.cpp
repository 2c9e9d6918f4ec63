#include "core/trajectory/joint_motion.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace multipanda {
namespace {

constexpr double kSamePosition = 1e-9;  // positions closer than this are equal [rad]

JointVector zero(Eigen::Index n) { return JointVector::Zero(n); }

[[noreturn]] void refuse(const std::string& text) { throw std::invalid_argument(text); }

void check_vector(const JointVector& v, Eigen::Index n, const std::string& what) {
  if (v.size() != n)
    refuse(what + ": expected " + std::to_string(n) + " values, one per joint, found " +
           std::to_string(v.size()));
  if (!v.allFinite()) refuse(what + ": expected finite values");
}

void check_sample(const JointSample& sample) {
  const auto n = sample.position.size();
  if (n == 0) refuse("start: expected the positions of at least one joint");
  check_vector(sample.position, n, "start position");
  check_vector(sample.velocity, n, "start velocity");
  check_vector(sample.acceleration, n, "start acceleration");
}

JointMotionLimits scaled(const JointMotionLimits& limits, double scale, Eigen::Index n) {
  if (!(scale > 0 && scale <= 1))
    refuse("scale: expected a number above 0 and at most 1, found " + std::to_string(scale));
  const auto check = [n](const JointVector& v, const char* what) {
    check_vector(v, n, what);
    if (v.minCoeff() <= 0) refuse(std::string(what) + ": expected values above 0");
  };
  check(limits.velocity, "velocity limits");
  check(limits.acceleration, "acceleration limits");
  check(limits.jerk, "jerk limits");
  return {scale * limits.velocity, scale * limits.acceleration, scale * limits.jerk};
}

// A joint passes a via point with the slower of the two adjacent mean velocities if they have the same sign,
// otherwise at rest, and without acceleration. So the velocity within a piece keeps its sign: with
// S(u) = 3u^2 - 2u^3 it is v0 (1 - S) + v1 S + (m - (v0 + v1) / 2) 30 u^2 (1 - u)^2, and the mean velocity m
// is no smaller than v0 or v1.
std::vector<QuinticPiece> pass(const std::vector<JointVector>& points, const std::vector<double>& durations) {
  const auto n = points.front().size();
  const std::size_t count = durations.size();
  std::vector<JointSample> samples;
  for (const auto& point : points) samples.push_back({point, zero(n), zero(n)});
  for (std::size_t k = 1; k < count; ++k) {
    const JointVector before = (points[k] - points[k - 1]) / durations[k - 1],
                      after = (points[k + 1] - points[k]) / durations[k];
    for (Eigen::Index i = 0; i < n; ++i) {
      if (before[i] * after[i] > 0)
        samples[k].velocity[i] = std::abs(before[i]) < std::abs(after[i]) ? before[i] : after[i];
    }
  }
  std::vector<QuinticPiece> pieces;
  for (std::size_t k = 0; k < count; ++k)
    pieces.push_back(QuinticPiece::between(samples[k], samples[k + 1], durations[k]));
  return pieces;
}

double stretch_of(const QuinticPiece& piece, const JointMotionLimits& limits) {
  const JointPeaks peaks = peaks_of(piece);
  return stretch_for(peaks.velocity.cwiseQuotient(limits.velocity).maxCoeff(),
                     peaks.acceleration.cwiseQuotient(limits.acceleration).maxCoeff(),
                     peaks.jerk.cwiseQuotient(limits.jerk).maxCoeff());
}

double total(const std::vector<QuinticPiece>& pieces) {
  double sum = 0;
  for (const auto& piece : pieces) sum += piece.duration;
  return sum;
}

}  // namespace

JointMotion::JointMotion(const JointVector& rest) : JointMotion(rest, {}, {}) {}

JointMotion::JointMotion(const JointVector& start, std::vector<QuinticPiece> pieces,
                         std::vector<double> knots)
    : start_(start), end_(start), pieces_(std::move(pieces)), starts_{0.0}, knots_(std::move(knots)) {
  for (const auto& piece : pieces_) starts_.push_back(starts_.back() + piece.duration);
  if (pieces_.empty()) return;
  JointSample end;
  pieces_.back().evaluate(pieces_.back().duration, end);
  end_ = end.position;
}

JointSample JointMotion::sample(double t) const {
  JointSample out{start_, zero(start_.size()), zero(start_.size())};
  if (!(t >= 0)) return out;
  if (t >= duration()) {
    out.position = end_;
    return out;
  }
  const auto k =
      static_cast<std::size_t>(std::upper_bound(starts_.begin(), starts_.end(), t) - starts_.begin()) - 1;
  pieces_[k].evaluate(t - starts_[k], out);
  return out;
}

JointPeaks JointMotion::peaks() const {
  const auto n = start_.size();
  JointPeaks peaks{start_.cwiseMin(end_), start_.cwiseMax(end_), zero(n), zero(n), zero(n)};
  for (const auto& piece : pieces_) peaks.include(peaks_of(piece));
  return peaks;
}

JointMotion joint_brake(const JointSample& from, const JointMotionLimits& limits, double scale) {
  check_sample(from);
  const JointMotionLimits within = scaled(limits, scale, from.position.size());
  return {from.position, stopping_pieces(from, within.acceleration, within.jerk), {}};
}

JointMotion joint_via_motion(const JointSample& start, std::span<const JointVector> via,
                             const JointMotionLimits& limits, double scale) {
  check_sample(start);
  if (via.empty()) refuse("via points: expected at least one");
  const auto n = start.position.size();
  const JointMotionLimits within = scaled(limits, scale, n);
  std::vector<QuinticPiece> pieces = stopping_pieces(start, within.acceleration, within.jerk);
  const double begin = total(pieces);

  // Equal successive via points share one point.
  std::vector<JointVector> points{JointMotion(start.position, pieces, {}).sample(begin).position};
  std::vector<std::size_t> point_of;  // per via point
  std::vector<double> durations;
  for (std::size_t k = 0; k < via.size(); ++k) {
    check_vector(via[k], n, "via point " + std::to_string(k + 1));
    double duration = 0;
    for (Eigen::Index i = 0; i < n; ++i) {
      duration =
          std::max(duration, rest_to_rest_duration(std::abs(via[k][i] - points.back()[i]), within.velocity[i],
                                                   within.acceleration[i], within.jerk[i]));
    }
    if ((via[k] - points.back()).cwiseAbs().maxCoeff() > kSamePosition) {
      points.push_back(via[k]);
      durations.push_back(duration);
    }
    point_of.push_back(points.size() - 1);
  }
  std::vector<double> reached{begin};
  if (!durations.empty()) {
    durations = shortest_durations(durations, [&](const std::vector<double>& tried) {
      std::vector<double> stretches;
      for (const auto& piece : pass(points, tried)) stretches.push_back(stretch_of(piece, within));
      return stretches;
    });
    for (const auto& piece : pass(points, durations)) {
      pieces.push_back(piece);
      reached.push_back(reached.back() + piece.duration);
    }
  }
  std::vector<double> knots;
  for (const std::size_t point : point_of) knots.push_back(reached[point]);
  return {start.position, std::move(pieces), std::move(knots)};
}

JointMotion joint_trajectory(std::span<const TrajectoryPoint> points,
                             const std::optional<JointSample>& start) {
  if (points.empty()) refuse("trajectory: expected at least one point");
  std::vector<TrajectoryPoint> list(points.begin(), points.end());
  const auto n = list.front().position.size();
  if (n == 0) refuse("trajectory: expected positions in every point");
  for (std::size_t k = 0; k < list.size(); ++k) {
    const std::string what = "trajectory point " + std::to_string(k + 1);
    const TrajectoryPoint& point = list[k];
    check_vector(point.position, n, what + ", positions");
    if (point.velocity.size() != 0) check_vector(point.velocity, n, what + ", velocities");
    if (point.acceleration.size() != 0) {
      check_vector(point.acceleration, n, what + ", accelerations");
      if (point.velocity.size() == 0) refuse(what + ": has accelerations but no velocities; expected both");
    }
    if (!std::isfinite(point.time_s)) refuse(what + ": expected a finite time");
    if (k == 0 && start && point.time_s <= 0)
      refuse(what + ": expected a time above 0, since the motion begins at the current position");
    if (k == 0 && !start && point.time_s != 0) refuse(what + ": expected time 0, since no start is given");
    if (k > 0 && point.time_s <= list[k - 1].time_s)
      refuse(what + ": expected a time after that of the previous point, " +
             std::to_string(list[k - 1].time_s) + " s");
  }
  std::vector<double> knots;
  for (const auto& point : list) knots.push_back(point.time_s);
  if (start) {
    check_sample(*start);
    check_vector(start->position, n, "start position");
    TrajectoryPoint first{0, start->position, {}, {}};
    if (list.front().velocity.size() != 0) first.velocity = start->velocity;
    if (list.front().acceleration.size() != 0) first.acceleration = start->acceleration;
    list.insert(list.begin(), first);
  }
  std::vector<QuinticPiece> pieces;
  for (std::size_t k = 0; k + 1 < list.size(); ++k) {
    const TrajectoryPoint &from = list[k], &to = list[k + 1];
    const double T = to.time_s - from.time_s;
    if (from.acceleration.size() != 0 && to.acceleration.size() != 0) {
      pieces.push_back(QuinticPiece::between({from.position, from.velocity, from.acceleration},
                                             {to.position, to.velocity, to.acceleration}, T));
      continue;
    }
    QuinticPiece piece{.duration = T, .size = static_cast<std::size_t>(n)};
    const bool cubic = from.velocity.size() != 0 && to.velocity.size() != 0;
    for (Eigen::Index i = 0; i < n; ++i) {
      auto& c = piece.coordinates[static_cast<std::size_t>(i)].c;
      const double mean = (to.position[i] - from.position[i]) / T;
      c = {from.position[i], mean};
      if (!cubic) continue;
      c[1] = from.velocity[i];
      c[2] = (3 * mean - 2 * from.velocity[i] - to.velocity[i]) / T;
      c[3] = (from.velocity[i] + to.velocity[i] - 2 * mean) / (T * T);
    }
    pieces.push_back(piece);
  }
  return {list.front().position, std::move(pieces), std::move(knots)};
}

}  // namespace multipanda
