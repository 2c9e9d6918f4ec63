#pragma once

#include <span>

#include "core/types/spatial.hpp"

// The circular-field law as pure functions: attraction to the goal, turning around an obstacle, and a
// barrier that keeps a minimum distance. A hand is a sphere of unit mass, so forces are accelerations.
// World axes, SI.
//
// Each obstacle acts like a current whose magnetic field turns a moving charge. The force is
// perpendicular to the velocity and does no work. So, unlike repulsion, it neither accelerates a hand nor
// creates a local minimum.
namespace multipanda::circular_field {

// A moving sphere.
struct Ball {
  Vector3 position = Vector3::Zero();  // [m]
  Vector3 velocity = Vector3::Zero();  // [m/s]
  double radius = 0;                   // [m]
};

struct FieldGains {
  double cruise = 0.4;      // desired speed far from the goal [m/s]
  double approach = 1.5;    // k_p: near the goal the desired speed is k_p times the distance [1/s]
  double pull = 6.0;        // k_v: rate at which the velocity follows the desired one [1/s]
  double range = 0.25;      // clearance below which an obstacle turns a hand [m]
  double turn_rate = 12.0;  // turn rate of the velocity at zero clearance [rad/s]
  double clearance = 0.03;  // minimum distance to every obstacle, other hand and wall [m]
  double braking = 6.0;     // k_b: a gap h to that clearance may close at k_b h at most [1/s]
};

// k_v (v_d - v) with v_d towards the goal: cruise speed, less near it [m/s^2].
Vector3 attraction(const FieldGains& gains, const Vector3& to_goal, const Vector3& velocity);

// The side on which to pass an obstacle: the unit vector from its center to the hand at their closest
// approach if both keep their velocities. If they meet head on, `preferred` (unit length or zero) decides. If
// that is zero, a fixed rule gives approaching hands opposite sides.
Vector3 passing_side(const Ball& hand, const Ball& obstacle, const Vector3& preferred);

// The circular field of one obstacle: F = v x (c x v) Omega / |v|, c the passing side. Omega, the turn rate
// of the velocity, grows with the square of the nearness and is zero out of range and when hand and obstacle
// separate. F is perpendicular to v. [m/s^2]
Vector3 circular_force(const FieldGains& gains, const Ball& hand, const Ball& obstacle, const Vector3& side);

// A half-space of accelerations: normal . a >= bound.
struct Barrier {
  Vector3 normal = Vector3::UnitX();
  double bound = 0;
};

// Keeps the gap h between two balls: with k_b of the gains, h'' + 2 k_b h' + k_b^2 h >= 0, so that h decays
// no faster than a critically damped motion and never changes sign. This hand contributes `share` of it: 1
// for an obstacle, 1/2 for another hand, which contributes the other half.
Barrier ball_barrier(const FieldGains& gains, const Ball& hand, const Ball& obstacle, double share);
// The same for a wall at `distance` from the hand's center, `inward` its unit normal.
Barrier wall_barrier(const FieldGains& gains, const Ball& hand, double distance, const Vector3& inward);

// The acceleration nearest to `desired` that all barriers allow, by Hildreth's method: a few sweeps over the
// barriers. `multipliers` is scratch space, one number per barrier.
Vector3 nearest_allowed(const Vector3& desired, std::span<const Barrier> barriers,
                        std::span<double> multipliers);

}  // namespace multipanda::circular_field
