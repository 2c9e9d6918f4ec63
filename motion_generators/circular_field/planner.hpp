#pragma once

#include <span>
#include <string>
#include <vector>

#include "motion_generators/circular_field/field.hpp"

namespace multipanda::circular_field {

struct Limits {
  double speed = 0.5;           // of a hand, never exceeded [m/s]
  double acceleration = 6.0;    // of a hand [m/s^2]; twice that to keep clear of an obstacle
  double jerk = 200.0;          // of a hand [m/s^3]
  double angular_speed = 1.0;   // [rad/s]
  double arrived = 0.005;       // a hand has arrived within this distance of its goal [m]
  double arrived_angle = 0.02;  // [rad]
  double arrived_speed = 0.05;  // [m/s]
};

// A box that the hand must not leave, world axes [m].
struct Workspace {
  Vector3 min, max;
};

struct HandSpec {
  std::string name;
  double radius = 0.08;              // of the sphere about the pose's origin that models the hand [m]
  std::vector<Workspace> workspace;  // none or one
};

// The state of a hand and the forces of the last step.
struct HandState {
  Pose X_W;
  Vector3 velocity = Vector3::Zero();          // [m/s]
  Vector3 acceleration = Vector3::Zero();      // [m/s^2]
  Vector3 angular_velocity = Vector3::Zero();  // world axes [rad/s]
  Vector3 attraction = Vector3::Zero();        // of the last step [m/s^2]
  Vector3 obstacle_force = Vector3::Zero();    // sum of the circular fields of the last step
  Vector3 velocity_before = Vector3::Zero();   // before the last step; perpendicular to obstacle_force
  bool arrived = false;                        // at its goal, slow
};

// Moves any number of hands to their goals around moving balls and around each other. Its inputs are dt and
// the obstacles, its outputs the poses: it has no clock, file or transport. One thread. Allocates only when
// the number of obstacles reaches a new maximum.
class Planner {
 public:
  // Throws std::invalid_argument for no hand, or sizes and limits that are not positive.
  Planner(std::vector<HandSpec> hands, const FieldGains& gains, const Limits& limits);

  std::size_t hand_count() const { return specs_.size(); }
  const HandSpec& spec(std::size_t hand) const { return specs_[hand]; }
  const HandState& hand(std::size_t hand) const { return states_[hand]; }

  // Places the hand at rest at this pose, which also becomes its goal.
  void place(std::size_t hand, const Pose& X_W);
  void set_goal(std::size_t hand, const Pose& X_W_goal);
  const Pose& goal(std::size_t hand) const { return goals_[hand]; }
  // Makes all hands brake to rest while they still avoid obstacles. set_goal() ends this for its hand.
  void brake();

  // Performs one step of dt <= 0.01 [s]. Pass the same `obstacles`, in the same order, at every step.
  void step(double dt, std::span<const Ball> obstacles);

  // Smallest current gap between a hand and an obstacle or another hand [m]; negative if they overlap.
  double clearance(std::span<const Ball> obstacles) const;

 private:
  Ball ball(std::size_t hand) const;
  Vector3 desired_acceleration(std::size_t hand, std::span<const Ball> obstacles, double dt);
  Vector3 steer(std::size_t hand, std::size_t slot, const Ball& other, double dt);
  Vector3 guarded(std::size_t hand, const Vector3& desired, std::span<const Ball> obstacles);
  void turn(std::size_t hand, double dt);

  std::vector<HandSpec> specs_;
  FieldGains gains_;
  Limits limits_;
  std::vector<HandState> states_;
  std::vector<Pose> goals_;
  std::vector<bool> braking_;
  std::vector<Vector3> next_;  // accelerations of this step
  // [hand][other hands, then obstacles]: passing sides; zero if none.
  std::vector<std::vector<Vector3>> sides_;
  std::vector<Barrier> barriers_;
  std::vector<double> multipliers_;
};

}  // namespace multipanda::circular_field
