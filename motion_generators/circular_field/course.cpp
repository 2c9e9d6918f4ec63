#include "motion_generators/circular_field/course.hpp"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace multipanda::circular_field {

Ball MovingBall::at(double t) const {
  const double rate = 2 * std::numbers::pi / period;
  return {position + t * velocity + std::sin(rate * t + phase) * amplitude,
          velocity + rate * std::cos(rate * t + phase) * amplitude, radius};
}

std::vector<HandSpec> Course::specs() const {
  std::vector<HandSpec> list;
  for (const auto& hand : hands) list.push_back(hand.spec);
  return list;
}

CourseRun::CourseRun(Course course, const std::vector<Pose>& starts)
    : course_(std::move(course)),
      planner_(course_.specs(), course_.gains, course_.limits),
      balls_(course_.obstacles.size()),
      next_goal_(course_.hands.size(), 0),
      reached_(course_.hands.size(), 0) {
  if (starts.size() != course_.hands.size()) {
    throw std::invalid_argument("course '" + course_.name + "' has " + std::to_string(course_.hands.size()) +
                                " hands, not " + std::to_string(starts.size()));
  }
  for (std::size_t i = 0; i < starts.size(); ++i) {
    planner_.place(i, starts[i]);
    if (!course_.hands[i].goals.empty()) planner_.set_goal(i, course_.hands[i].goals.front());
  }
  move_obstacles();
}

void CourseRun::move_obstacles() {
  for (std::size_t i = 0; i < balls_.size(); ++i) balls_[i] = course_.obstacles[i].at(time_);
}

void CourseRun::step(double dt) {
  planner_.step(dt, balls_);
  time_ += dt;
  move_obstacles();
  for (std::size_t i = 0; i < next_goal_.size(); ++i) {
    const auto& goals = course_.hands[i].goals;
    if (next_goal_[i] == goals.size() || !planner_.hand(i).arrived) continue;
    ++reached_[i];
    if (++next_goal_[i] == goals.size() && course_.repeat && goals.size() > 1) next_goal_[i] = 0;
    if (next_goal_[i] < goals.size()) planner_.set_goal(i, goals[next_goal_[i]]);
  }
}

void CourseRun::brake() { planner_.brake(); }

bool CourseRun::finished() const {
  for (std::size_t i = 0; i < next_goal_.size(); ++i) {
    if (next_goal_[i] < course_.hands[i].goals.size()) return false;
  }
  return true;
}

bool CourseRun::at_rest() const {
  for (std::size_t i = 0; i < planner_.hand_count(); ++i) {
    const HandState& hand = planner_.hand(i);
    if (hand.velocity.norm() > 1e-3 || hand.angular_velocity.norm() > 1e-3) return false;
  }
  return true;
}

}  // namespace multipanda::circular_field
