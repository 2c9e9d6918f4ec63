#include "core/trajectory/pose_motion.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/types/spatial.hpp"

namespace multipanda {
namespace {

[[noreturn]] void refuse_poses(const std::string& text) { throw std::invalid_argument(text); }

constexpr double kWidestTurn = 3.13159265;  // pi - 0.01: nearer to pi rounding decides the direction [rad]
constexpr double kSamePose = 1e-7;          // poses closer than this are equal [m, rad]
constexpr int kChecks = 100;                // points of a piece at which limits are checked
constexpr double kBetweenChecks = 0.997;    // fraction of the limits, since peaks lie between the points

void check_pose(const Pose& X, const std::string& what) {
  if (!X.position.allFinite() || !X.rotation.allFinite()) refuse_poses(what + ": expected finite values");
  if ((X.rotation * X.rotation.transpose() - Matrix3::Identity()).norm() > 1e-6 ||
      X.rotation.determinant() < 0) {
    refuse_poses(what + ": expected a rotation (orthonormal, right-handed)");
  }
}

PoseMotionLimits scaled(const PoseMotionLimits& limits, double scale) {
  if (!(scale > 0 && scale <= 1))
    refuse_poses("scale: expected a number above 0 and at most 1, found " + std::to_string(scale));
  PoseMotionLimits within = limits;
  for (double* limit : {&within.speed, &within.acceleration, &within.jerk, &within.angular_speed,
                        &within.angular_acceleration, &within.angular_jerk}) {
    if (!(std::isfinite(*limit) && *limit > 0))
      refuse_poses("pose motion limits: expected finite numbers above 0");
    *limit *= scale;
  }
  return within;
}

JointSample at_rest(const Vector3& position, const Vector3& rotation) {
  JointSample sample;
  sample.position = (Vector6() << position, rotation).finished();
  sample.velocity = sample.acceleration = Vector6::Zero();
  return sample;
}

// A pose passed with a velocity and no acceleration.
struct Passage {
  Pose X;
  Vector3 velocity = Vector3::Zero(), angular_velocity = Vector3::Zero();
};

// The piece from one passage to the next, along the shorter rotation.
PoseMotion::Piece between(const Passage& from, const Passage& to, double duration_s) {
  const Vector3 r = log_rotation(to.X.rotation * from.X.rotation.transpose());
  const Matrix3 inverse = left_jacobian(r).inverse();
  JointSample begin = at_rest(from.X.position, Vector3::Zero()), end = at_rest(to.X.position, r);
  begin.velocity << from.velocity, from.angular_velocity;  // at r = 0 its rate is the angular velocity
  const Vector3 dr = inverse * to.angular_velocity;
  end.velocity << to.velocity, dr;
  end.acceleration << Vector3::Zero(), -(inverse * left_jacobian_rate(r, dr));
  return {from.X.rotation, QuinticPiece::between(begin, end, duration_s)};
}

// The velocity at a via point: the slower of the two mean velocities, in the direction between them, and
// slower at sharper bends. It does not depend on the choice of axes.
Vector3 passing_velocity(const Vector3& before, const Vector3& after) {
  const double slow = std::min(before.norm(), after.norm());
  if (slow == 0) return Vector3::Zero();
  const double bend = before.normalized().dot(after.normalized());
  if (bend <= 0) return Vector3::Zero();
  return slow * bend * (before.normalized() + after.normalized()).normalized();
}

std::vector<PoseMotion::Piece> pass(const std::vector<Pose>& points, const std::vector<double>& durations) {
  const std::size_t count = durations.size();
  std::vector<Passage> passages;
  for (const auto& point : points) passages.push_back({.X = point});
  for (std::size_t k = 1; k < count; ++k) {
    const Vector6 before = pose_error(points[k], points[k - 1]) / durations[k - 1],
                  after = pose_error(points[k + 1], points[k]) / durations[k];
    passages[k].velocity = passing_velocity(before.head<3>(), after.head<3>());
    passages[k].angular_velocity = passing_velocity(before.tail<3>(), after.tail<3>());
  }
  std::vector<PoseMotion::Piece> pieces;
  for (std::size_t k = 0; k < count; ++k)
    pieces.push_back(between(passages[k], passages[k + 1], durations[k]));
  return pieces;
}

double stretch_of(const PoseMotion::Piece& piece, const PoseMotionLimits& limits) {
  double speed = 0, acceleration = 0, jerk = 0, turning = 0, angular_acceleration = 0, angular_jerk = 0;
  const double h = piece.path.duration / kChecks;
  Vector3 last = Vector3::Zero();
  for (int k = 0; k <= kChecks; ++k) {
    const double t = k * h;
    const PoseSample now = piece.evaluate(t);
    speed = std::max(speed, now.V.linear().norm());
    acceleration = std::max(acceleration, now.A.linear().norm());
    turning = std::max(turning, now.V.angular().norm());
    angular_acceleration = std::max(angular_acceleration, now.A.angular().norm());
    Vector3 third;
    for (Eigen::Index i = 0; i < 3; ++i) {
      const auto& c = piece.path.coordinates[static_cast<std::size_t>(i)].c;
      third[i] = 6 * c[3] + 24 * t * c[4] + 60 * t * t * c[5];
    }
    jerk = std::max(jerk, third.norm());
    if (k > 0) angular_jerk = std::max(angular_jerk, (now.A.angular() - last).norm() / h);
    last = now.A.angular();
  }
  // The angular jerk is a mean over an interval. At the piece's ends, where it is largest, it is up to
  // 3 % larger.
  constexpr double kMean = 0.97;
  return std::max(
             stretch_for(speed / limits.speed, acceleration / limits.acceleration, jerk / limits.jerk),
             stretch_for(turning / limits.angular_speed, angular_acceleration / limits.angular_acceleration,
                         angular_jerk / (kMean * limits.angular_jerk))) /
         kBetweenChecks;
}

// Pieces from a sample to a stop. Each axis has its fraction of the limits, so that the norms stay within
// them. kCurvature leaves room for the difference between angular acceleration and the rotation
// vector's second derivative.
std::vector<PoseMotion::Piece> stop(const PoseSample& from, const PoseMotionLimits& within) {
  check_pose(from.X, "start");
  if (!from.V.vector.allFinite() || !from.A.vector.allFinite())
    refuse_poses("start: expected a finite velocity and acceleration");
  constexpr double kCurvature = 0.9;
  const double axis = 1 / std::sqrt(3.0);
  JointSample sample = at_rest(from.X.position, Vector3::Zero());
  sample.velocity = from.V.vector;
  sample.acceleration = from.A.vector;
  JointVector acceleration(6), jerk(6);
  acceleration << Vector3::Constant(axis * within.acceleration),
      Vector3::Constant(axis * kCurvature * within.angular_acceleration);
  jerk << Vector3::Constant(axis * within.jerk), Vector3::Constant(axis * kCurvature * within.angular_jerk);
  std::vector<PoseMotion::Piece> pieces;
  for (const auto& path : stopping_pieces(sample, acceleration, jerk))
    pieces.push_back({from.X.rotation, path});
  return pieces;
}

}  // namespace

PoseSample PoseMotion::Piece::evaluate(double t) const {
  JointSample s;
  path.evaluate(t, s);
  const Vector3 r = s.position.tail<3>(), dr = s.velocity.tail<3>(), ddr = s.acceleration.tail<3>();
  const Matrix3 J = left_jacobian(r);
  PoseSample out;
  out.X.position = s.position.head<3>();
  out.X.rotation = exp_rotation(r) * R_0;
  out.V.linear() = s.velocity.head<3>();
  out.V.angular() = J * dr;
  out.A.linear() = s.acceleration.head<3>();
  out.A.angular() = J * ddr + left_jacobian_rate(r, dr);
  return out;
}

PoseMotion::PoseMotion(const Pose& rest) : PoseMotion(rest, {}, {}) {}

PoseMotion::PoseMotion(const Pose& start, std::vector<Piece> pieces, std::vector<double> knots)
    : start_(start), end_(start), pieces_(std::move(pieces)), starts_{0.0}, knots_(std::move(knots)) {
  for (const auto& piece : pieces_) starts_.push_back(starts_.back() + piece.path.duration);
  if (!pieces_.empty()) end_ = pieces_.back().evaluate(pieces_.back().path.duration).X;
}

PoseSample PoseMotion::sample(double t) const {
  if (!(t >= 0)) return {start_, {}, {}};
  if (t >= duration()) return {end_, {}, {}};
  const auto k =
      static_cast<std::size_t>(std::upper_bound(starts_.begin(), starts_.end(), t) - starts_.begin()) - 1;
  return pieces_[k].evaluate(t - starts_[k]);
}

PoseMotion pose_brake(const PoseSample& from, const PoseMotionLimits& limits, double scale) {
  const PoseMotionLimits within = scaled(limits, scale);
  return {from.X, stop(from, within), {}};
}

PoseMotion pose_via_motion(const PoseSample& start, std::span<const Pose> via, const PoseMotionLimits& limits,
                           double scale) {
  if (via.empty()) refuse_poses("via points: expected at least one");
  const PoseMotionLimits within = scaled(limits, scale);
  std::vector<PoseMotion::Piece> pieces = stop(start, within);
  const PoseMotion stopped(start.X, pieces, {});
  std::vector<Pose> points{stopped.sample(stopped.duration()).X};
  std::vector<std::size_t> point_of;  // per via point
  std::vector<double> durations;
  for (std::size_t k = 0; k < via.size(); ++k) {
    const std::string what = "via point " + std::to_string(k + 1);
    check_pose(via[k], what);
    const Vector6 way = pose_error(via[k], points.back());
    if (way.tail<3>().norm() > kWidestTurn) {
      refuse_poses(
          what +
          ": half a revolution from the point before, so the direction is not defined; expected less than " +
          "3.13 rad; add a via point in between");
    }
    const double duration =
        std::max(rest_to_rest_duration(way.head<3>().norm(), within.speed, within.acceleration, within.jerk),
                 rest_to_rest_duration(way.tail<3>().norm(), within.angular_speed,
                                       within.angular_acceleration, within.angular_jerk));
    if (way.norm() > kSamePose) {
      points.push_back(via[k]);
      durations.push_back(duration);
    }
    point_of.push_back(points.size() - 1);
  }
  std::vector<double> reached{stopped.duration()};
  if (!durations.empty()) {
    durations = shortest_durations(durations, [&](const std::vector<double>& tried) {
      std::vector<double> stretches;
      for (const auto& piece : pass(points, tried)) stretches.push_back(stretch_of(piece, within));
      return stretches;
    });
    for (auto& piece : pass(points, durations)) {
      reached.push_back(reached.back() + piece.path.duration);
      pieces.push_back(std::move(piece));
    }
  }
  std::vector<double> knots;
  for (const std::size_t point : point_of) knots.push_back(reached[point]);
  return {start.X, std::move(pieces), std::move(knots)};
}

}  // namespace multipanda
