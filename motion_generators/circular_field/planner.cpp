#include "motion_generators/circular_field/planner.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace multipanda::circular_field {
namespace {

constexpr double kKeepSide = 2.0;      // rate at which a chosen passing side may change [1/s]
constexpr double kForgetRange = 1.2;   // times the field's range: farther away, the side is dropped
constexpr double kSpeedShare = 0.96;   // fraction of the speed limit that is used
constexpr double kSpeedBraking = 20;   // rate at which the remaining fraction may be used up [1/s]
constexpr double kTurnPull = 8.0;      // gain of the angular velocity [1/s]
constexpr double kTurnApproach = 2.0;  // gain of the orientation error [1/s]

void require(bool holds, const std::string& what) {
  if (!holds) throw std::invalid_argument("circular field: " + what);
}

// v, limited to the length `most`.
Vector3 at_most(const Vector3& v, double most) {
  const double length = v.norm();
  return length > most ? Vector3(v * (most / length)) : v;
}

double surface_distance(const Ball& a, const Ball& b) {
  return (a.position - b.position).norm() - a.radius - b.radius;
}

}  // namespace

Planner::Planner(std::vector<HandSpec> hands, const FieldGains& gains, const Limits& limits)
    : specs_(std::move(hands)), gains_(gains), limits_(limits) {
  require(!specs_.empty(), "expected at least one hand");
  for (const auto& spec : specs_) {
    require(spec.radius > 0, "hand '" + spec.name + "': expected a radius above 0");
    for (const auto& box : spec.workspace) {
      require(((box.max - box.min).array() > 2 * (spec.radius + gains.clearance)).all(),
              "hand '" + spec.name + "': its workspace is too small for its radius and clearance");
    }
  }
  require(gains.cruise > 0 && gains.cruise <= limits.speed,
          "expected a cruise speed above 0 and at most the speed limit");
  require(gains.range > 0 && gains.pull > 0 && gains.approach > 0 && gains.braking > 0,
          "expected gains above 0");
  require(limits.acceleration > 0 && limits.jerk > 0 && limits.angular_speed > 0, "expected limits above 0");
  states_.resize(specs_.size());
  goals_.resize(specs_.size());
  braking_.assign(specs_.size(), false);
  next_.assign(specs_.size(), Vector3::Zero());
  sides_.assign(specs_.size(), std::vector<Vector3>(specs_.size(), Vector3::Zero()));
}

void Planner::place(std::size_t hand, const Pose& X_W) {
  states_[hand] = HandState{};
  states_[hand].X_W = X_W;
  states_[hand].arrived = true;
  std::fill(sides_[hand].begin(), sides_[hand].end(), Vector3::Zero());
  set_goal(hand, X_W);
}

void Planner::set_goal(std::size_t hand, const Pose& X_W_goal) {
  goals_[hand] = X_W_goal;
  braking_[hand] = false;
  states_[hand].arrived = false;
}

void Planner::brake() { braking_.assign(specs_.size(), true); }

Ball Planner::ball(std::size_t hand) const {
  return {states_[hand].X_W.position, states_[hand].velocity, specs_[hand].radius};
}

// A chosen side changes only slowly, so that two adjacent obstacles do not make a hand oscillate.
Vector3 Planner::steer(std::size_t hand, std::size_t slot, const Ball& other, double dt) {
  const Ball own = ball(hand);
  Vector3& side = sides_[hand][slot];
  if (surface_distance(own, other) > kForgetRange * gains_.range) {
    side.setZero();
    return Vector3::Zero();
  }
  const Vector3 now = passing_side(own, other, side);
  if (side.isZero()) {
    side = now;
  } else {
    const Vector3 blended = side + std::min(1.0, kKeepSide * dt) * (now - side);
    if (blended.norm() > 1e-3) side = blended.normalized();
  }
  return circular_force(gains_, own, other, now);
}

Vector3 Planner::desired_acceleration(std::size_t hand, std::span<const Ball> obstacles, double dt) {
  HandState& state = states_[hand];
  const Vector3 to_goal =
      braking_[hand] ? Vector3(Vector3::Zero()) : Vector3(goals_[hand].position - state.X_W.position);
  state.attraction = attraction(gains_, to_goal, state.velocity);
  state.obstacle_force.setZero();
  state.velocity_before = state.velocity;
  for (std::size_t other = 0; other < specs_.size(); ++other) {
    if (other != hand) state.obstacle_force += steer(hand, other, ball(other), dt);
  }
  for (std::size_t i = 0; i < obstacles.size(); ++i) {
    state.obstacle_force += steer(hand, specs_.size() + i, obstacles[i], dt);
  }
  // Near the goal, turning away from an obstacle would make the hand circle the goal.
  state.obstacle_force *= std::min(1.0, to_goal.norm() / gains_.range);
  return at_most(state.attraction + state.obstacle_force, limits_.acceleration);
}

// The barriers override the desired acceleration. Steering alone cannot keep the clearance: it does not act
// on a hand at rest, and an obstacle may approach a hand that waits at its goal.
Vector3 Planner::guarded(std::size_t hand, const Vector3& desired, std::span<const Ball> obstacles) {
  const Ball own = ball(hand);
  barriers_.clear();
  for (const auto& box : specs_[hand].workspace) {
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3 inward = Vector3::Unit(axis);
      barriers_.push_back(wall_barrier(gains_, own, own.position[axis] - box.min[axis], inward));
      barriers_.push_back(wall_barrier(gains_, own, box.max[axis] - own.position[axis], -inward));
    }
  }
  for (std::size_t other = 0; other < specs_.size(); ++other) {
    if (other != hand) barriers_.push_back(ball_barrier(gains_, own, ball(other), 0.5));
  }
  for (const Ball& obstacle : obstacles) barriers_.push_back(ball_barrier(gains_, own, obstacle, 1));
  // The speed approaches its limit smoothly: clipping it in step() would cause a jerk.
  if (const double speed = own.velocity.norm(); speed > 0.5 * limits_.speed) {
    barriers_.push_back({-own.velocity / speed, kSpeedBraking * (speed - kSpeedShare * limits_.speed)});
  }
  multipliers_.resize(barriers_.size());
  return at_most(nearest_allowed(desired, barriers_, multipliers_), 2 * limits_.acceleration);
}

void Planner::turn(std::size_t hand, double dt) {
  HandState& state = states_[hand];
  const Vector3 error = braking_[hand] ? Vector3(Vector3::Zero())
                                       : log_rotation(goals_[hand].rotation * state.X_W.rotation.transpose());
  const Vector3 desired = at_most(kTurnApproach * error, limits_.angular_speed);
  state.angular_velocity += dt * kTurnPull * (desired - state.angular_velocity);
  state.X_W.rotation = exp_rotation(dt * state.angular_velocity) * state.X_W.rotation;
  state.X_W.rotation = state.X_W.quaternion().normalized().toRotationMatrix();
  state.arrived = !braking_[hand] && error.norm() < limits_.arrived_angle &&
                  (goals_[hand].position - state.X_W.position).norm() < limits_.arrived &&
                  state.velocity.norm() < limits_.arrived_speed;
}

void Planner::step(double dt, std::span<const Ball> obstacles) {
  const std::size_t slots = specs_.size() + obstacles.size();
  if (sides_.front().size() != slots) {
    for (auto& sides : sides_) sides.resize(slots, Vector3::Zero());
    barriers_.reserve(slots + 7);
    multipliers_.reserve(slots + 7);
  }
  // All hands plan on the same state before any of them moves.
  for (std::size_t i = 0; i < specs_.size(); ++i)
    next_[i] = guarded(i, desired_acceleration(i, obstacles, dt), obstacles);
  for (std::size_t i = 0; i < specs_.size(); ++i) {
    HandState& state = states_[i];
    state.acceleration += at_most(next_[i] - state.acceleration, limits_.jerk * dt);
    const Vector3 velocity = at_most(state.velocity + dt * state.acceleration, limits_.speed);
    state.acceleration = (velocity - state.velocity) / dt;
    state.velocity = velocity;
    state.X_W.position += dt * velocity;
    turn(i, dt);
  }
}

double Planner::clearance(std::span<const Ball> obstacles) const {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < specs_.size(); ++i) {
    for (std::size_t j = i + 1; j < specs_.size(); ++j)
      least = std::min(least, surface_distance(ball(i), ball(j)));
    for (const Ball& obstacle : obstacles) least = std::min(least, surface_distance(ball(i), obstacle));
  }
  return least;
}

}  // namespace multipanda::circular_field
