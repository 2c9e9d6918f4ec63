#include "motion_generators/circular_field/field.hpp"

#include <algorithm>

namespace multipanda::circular_field {
namespace {

constexpr double kSlow = 0.01;    // below this speed the direction of motion fades out [m/s]
constexpr double kHeadOn = 0.02;  // below this miss distance the preferred side decides [m]
constexpr int kSweeps = 40;

double smooth_step(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

double gap(const Ball& a, const Ball& b) { return (a.position - b.position).norm() - a.radius - b.radius; }

Vector3 unit_or(const Vector3& v, const Vector3& otherwise) {
  const double length = v.norm();
  return length > 1e-9 ? Vector3(v / length) : otherwise;
}

}  // namespace

Vector3 attraction(const FieldGains& gains, const Vector3& to_goal, const Vector3& velocity) {
  const double distance = to_goal.norm();
  const double desired = gains.approach * distance;
  const double slower = desired > gains.cruise ? gains.cruise / desired : 1;
  return gains.pull * (slower * gains.approach * to_goal - velocity);
}

Vector3 passing_side(const Ball& hand, const Ball& obstacle, const Vector3& preferred) {
  const Vector3 r = hand.position - obstacle.position;
  const Vector3 v = unit_or(hand.velocity - obstacle.velocity, unit_or(-r, Vector3::UnitX()));
  const auto across = [&](const Vector3& a) { return Vector3(a - a.dot(v) * v); };
  const Vector3 miss = across(r) + kHeadOn * across(preferred);
  if (miss.norm() > 1e-6) return miss.normalized();
  // Two approaching hands have opposite v and so take opposite sides. For vertical v the side is along x.
  return unit_or(v.cross(Vector3::UnitZ()), Vector3::UnitX());
}

Vector3 circular_force(const FieldGains& gains, const Ball& hand, const Ball& obstacle, const Vector3& side) {
  const double nearness = std::clamp(1 - gap(hand, obstacle) / gains.range, 0.0, 1.0);
  if (nearness == 0) return Vector3::Zero();
  const Vector3 r = unit_or(hand.position - obstacle.position, Vector3::UnitX());
  const Vector3 v_rel = hand.velocity - obstacle.velocity;
  const double parting = r.dot(v_rel) / (v_rel.norm() + kSlow);  // -1: head on, 0: passing
  const double turn_rate = gains.turn_rate * nearness * nearness * (1 - smooth_step(2 * parting));
  const Vector3& v = hand.velocity;
  return turn_rate / (v.norm() + kSlow) * v.cross(side.cross(v));
}

Barrier ball_barrier(const FieldGains& gains, const Ball& hand, const Ball& obstacle, double share) {
  const Vector3 r = hand.position - obstacle.position;
  const Vector3 n = unit_or(r, Vector3::UnitX());
  const Vector3 v = hand.velocity - obstacle.velocity;
  const double closing = n.dot(v);
  const double k = gains.braking;
  const double h = gap(hand, obstacle) - gains.clearance;
  // h'' = n . a + |v across|^2 / |r|. The second term only increases h'' and is omitted.
  return {n, share * (-2 * k * closing - k * k * h)};
}

Barrier wall_barrier(const FieldGains& gains, const Ball& hand, double distance, const Vector3& inward) {
  const double k = gains.braking;
  const double h = distance - hand.radius - gains.clearance;
  return {inward, -2 * k * inward.dot(hand.velocity) - k * k * h};
}

Vector3 nearest_allowed(const Vector3& desired, std::span<const Barrier> barriers,
                        std::span<double> multipliers) {
  std::fill_n(multipliers.begin(), barriers.size(), 0.0);
  Vector3 a = desired;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    double moved = 0;
    for (std::size_t i = 0; i < barriers.size(); ++i) {
      const double step = std::max(-multipliers[i], barriers[i].bound - barriers[i].normal.dot(a));
      multipliers[i] += step;
      a += step * barriers[i].normal;
      moved = std::max(moved, std::abs(step));
    }
    if (moved < 1e-9) break;
  }
  return a;
}

}  // namespace multipanda::circular_field
