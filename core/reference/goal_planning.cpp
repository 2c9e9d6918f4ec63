#include <algorithm>
#include <cmath>
#include <limits>

#include "core/reference/reference.hpp"

// Plans motions that end at rest at a goal.
namespace multipanda {
namespace {

// Acceleration limits of goals: a third of what the manufacturer allows (13 m/s^2, 25 rad/s^2), and two
// thirds for the slowest joint (7.5 rad/s^2).
constexpr double kGoalAcceleration = 4.0;         // [m/s^2]
constexpr double kGoalAngularAcceleration = 8.0;  // [rad/s^2]
constexpr double kGoalJointAcceleration = 5.0;    // [rad/s^2]
constexpr double kNoLimit = std::numeric_limits<double>::infinity();
constexpr double kLonger = 1.2;  // factor by which a motion that is too fast is stretched, repeatedly

}  // namespace

Reference::Aim Reference::aim_at(const Target& target) const {
  Aim aim;
  const auto& v = target.values;
  if (spec_.quantity == Quantity::pose) {
    const Vector3 r = log_rotation(Pose::from(v.data()).rotation * R_0_.transpose());
    for (std::size_t i = 0; i < 3; ++i) {
      aim.goal[i] = v[i];
      aim.goal[3 + i] = r[static_cast<Eigen::Index>(i)];
    }
  } else {
    std::copy_n(v.begin(), size_, aim.goal.begin());
  }
  QuinticSegment::Values way{};
  for (std::size_t i = 0; i < coordinates(); ++i) way[i] = aim.goal[i] - now_.position[i];
  aim.distance = magnitude(way);
  aim.shortest_s = std::max({rest_to_rest_duration(aim.distance.linear, spec_.max_speed),
                             rest_to_rest_duration(aim.distance.angular, spec_.max_angular_speed),
                             rest_to_rest_duration(hand_speed(way), hand_bound())});
  return aim;
}

void Reference::plan_goal(const Target& target) {
  rebase_to_rest();
  const Aim aim = aim_at(target);
  const Magnitude limit = goal_acceleration();
  const double gentle_s = std::max(rest_to_rest_duration(aim.distance.linear, kNoLimit, limit.linear),
                                   rest_to_rest_duration(aim.distance.angular, kNoLimit, limit.angular));
  plan_rest(aim.goal, std::max({target.duration_s, aim.shortest_s, gentle_s}), limit);
  if (now_.velocity == QuinticSegment::Values{} || peak_excess(24) <= 1) return;
  // In motion against it: the set-point brakes first, with 3/2 v / T + a / 4 at most. Otherwise each of many
  // goals would raise the speed that the next one accepts.
  const Magnitude speed = magnitude(now_.velocity);
  braking_s_ = std::max({kBrakingTime, 2 * speed.linear / limit.linear, 2 * speed.angular / limit.angular});
  QuinticSegment::Values rest = now_.position;
  for (std::size_t i = 0; i < coordinates(); ++i) rest[i] += 0.5 * braking_s_ * now_.velocity[i];
  segment_.plan(coordinates(), now_, rest, braking_s_);
  waiting_for_ = target;
  waiting_ = true;
}

// From the current motion to rest at the goal. `duration_s` suits a start at rest. A start in the wrong
// direction must reverse first and takes longer, so that speed and acceleration stay within their limits (or
// their current values, if those are higher). Otherwise goals in quick succession would exceed the
// torque-rate limit of an arm.
double Reference::plan_rest(const QuinticSegment::Values& goal, double duration_s,
                            const Magnitude& acceleration) {
  const Magnitude present = magnitude(now_.acceleration);
  const Magnitude allowed{std::max(acceleration.linear, present.linear),
                          std::max(acceleration.angular, present.angular)};
  double duration = std::max(duration_s, kBrakingTime);
  double best = duration, least = std::numeric_limits<double>::infinity();
  for (int attempt = 0; attempt < 16 && least > 1; ++attempt, duration *= kLonger) {
    segment_.plan(coordinates(), now_, goal, duration);
    if (const double excess = std::max(peak_excess(24), acceleration_excess(24, allowed)); excess < least) {
      least = excess;
      best = duration;
    }
  }
  segment_.plan(coordinates(), now_, goal, best);
  moving_end_ = false;
  return least;
}

// Highest speed of the planned segment relative to the limit (or to the current speed, if that is higher).
// From rest the pace has enough time to bound a pose's points; replanning in motion is faster than the pace.
double Reference::peak_excess(std::size_t samples) const {
  const bool moving = now_.velocity != QuinticSegment::Values{};
  const auto speeds = [&](const QuinticSegment::Sample& s) -> Magnitude {
    const Magnitude speed = magnitude(s.velocity);
    return {std::max({speed.linear / spec_.max_speed, hand_speed(s.velocity) / hand_bound(),
                      moving ? 1 / points_share(s) : 0}),
            speed.angular / spec_.max_angular_speed};
  };
  const auto [linear_now, angular_now] = speeds(now_);
  const double linear_limit = 1.001 * std::max(1.0, linear_now);
  const double angular_limit = 1.001 * std::max(1.0, angular_now);
  double excess = 0;
  QuinticSegment::Sample at;
  for (std::size_t k = 1; k < samples; ++k) {
    segment_.evaluate(segment_.duration() * static_cast<double>(k) / static_cast<double>(samples), at);
    const auto [linear, angular] = speeds(at);
    excess = std::max({excess, linear / linear_limit, angular / angular_limit});
  }
  return excess;
}

Reference::Magnitude Reference::goal_acceleration() const {
  if (spec_.quantity == Quantity::pose) return {kGoalAcceleration, kGoalAngularAcceleration};
  if (spec_.quantity == Quantity::joints) return {kGoalJointAcceleration, kNoLimit};
  return {kNoLimit, kNoLimit};  // forces and scalars do not accelerate a mass
}

Reference::Magnitude Reference::magnitude(const QuinticSegment::Values& v) const {
  if (spec_.quantity == Quantity::pose) {
    return {Vector3(v[0], v[1], v[2]).norm(), rotation_of(v).norm()};
  }
  double largest = 0;
  for (std::size_t i = 0; i < size_; ++i) largest = std::max(largest, std::abs(v[i]));
  return {largest, 0};
}

// Highest acceleration of the planned segment relative to the limit.
double Reference::acceleration_excess(std::size_t samples, const Magnitude& allowed) const {
  double excess = 0;
  QuinticSegment::Sample at;
  for (std::size_t k = 1; k < samples; ++k) {
    segment_.evaluate(segment_.duration() * static_cast<double>(k) / static_cast<double>(samples), at);
    const Magnitude found = magnitude(at.acceleration);
    excess = std::max(
        {excess, found.linear / (1.001 * allowed.linear), found.angular / (1.001 * allowed.angular)});
  }
  return excess;
}

}  // namespace multipanda
