#include <algorithm>
#include <cmath>
#include <limits>

#include "core/reference/reference.hpp"

// Ways to a rest at a goal.
namespace multipanda {
namespace {

// What a goal may cost: a third of what the arm's maker allows (13 m/s^2, 25 rad/s^2), two thirds for the
// slowest joint (7.5 rad/s^2).
constexpr double kGoalAcceleration = 4.0;         // [m/s^2]
constexpr double kGoalAngularAcceleration = 8.0;  // [rad/s^2]
constexpr double kGoalJointAcceleration = 5.0;    // [rad/s^2]
constexpr double kAny = std::numeric_limits<double>::infinity();
constexpr double kLonger = 1.2;  // by which a motion that would be too fast is stretched, several times

}  // namespace

Reference::Aim Reference::aim_at(const Target& target) const {
  Aim aim;
  const auto& v = target.values;
  if (spec_.quantity == Quantity::pose) {
    const Pose X = Pose::from({v[0], v[1], v[2]}, Quaternion(v[3], v[4], v[5], v[6]));
    const Vector3 r = log_rotation(X.rotation * R_0_.transpose());
    for (std::size_t i = 0; i < 3; ++i) {
      aim.goal[i] = v[i];
      aim.goal[3 + i] = r[static_cast<Eigen::Index>(i)];
    }
    aim.shortest_s =
        std::max(QuinticSegment::duration_for((X.position - X_d_.position).norm(), spec_.max_speed),
                 QuinticSegment::duration_for(r.norm(), spec_.max_angular_speed));
    return aim;
  }
  double farthest = 0;
  for (std::size_t i = 0; i < size_; ++i) {
    aim.goal[i] = v[i];
    farthest = std::max(farthest, std::abs(v[i] - now_.position[i]));
  }
  aim.shortest_s = QuinticSegment::duration_for(farthest, spec_.max_speed);
  return aim;
}

void Reference::plan_goal(const Target& target) {
  rebase();
  const Aim aim = aim_at(target);
  QuinticSegment::Values way{};
  for (std::size_t i = 0; i < coordinates(); ++i) way[i] = aim.goal[i] - now_.position[i];
  const Magnitude distance = magnitude(way), limit = goal_acceleration();
  const double gentle_s = std::max(QuinticSegment::duration_within(distance.linear, limit.linear),
                                   QuinticSegment::duration_within(distance.angular, limit.angular));
  plan_rest(aim.goal, std::max({target.duration_s, aim.shortest_s, gentle_s}), limit);
}

// From the present motion to a rest at the goal. `duration_s` suits a start at rest; one in the wrong
// direction has to turn back first and needs longer to stay within the speed and the acceleration (or the
// present ones, where those are higher): goals that follow each other faster than they are reached would else
// ask for torques that change faster than an arm's may.
void Reference::plan_rest(const QuinticSegment::Values& goal, double duration_s,
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
}

// The planned segment's highest speed over the allowed one (or the present one, where that is higher).
double Reference::peak_excess(std::size_t samples) const {
  const auto speeds = [&](const QuinticSegment::Sample& s) -> Magnitude {
    const Magnitude speed = magnitude(s.velocity);
    return {speed.linear / spec_.max_speed, speed.angular / spec_.max_angular_speed};
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
  if (spec_.quantity == Quantity::joints) return {kGoalJointAcceleration, kAny};
  return {kAny, kAny};  // no mass follows a force or a number as it follows a place
}

Reference::Magnitude Reference::magnitude(const QuinticSegment::Values& v) const {
  if (spec_.quantity == Quantity::pose) {
    return {Vector3(v[0], v[1], v[2]).norm(), rotation_of(v).norm()};
  }
  double largest = 0;
  for (std::size_t i = 0; i < size_; ++i) largest = std::max(largest, std::abs(v[i]));
  return {largest, 0};
}

// The planned segment's highest acceleration over the allowed one.
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
