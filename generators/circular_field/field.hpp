#pragma once

#include <span>

#include "core/types/spatial.hpp"

// The circular-field law as pure functions: what pulls a hand to its goal, what turns it round an obstacle,
// and what keeps a least distance. A hand is a sphere of unit mass, so forces are accelerations. World axes,
// SI.
//
// Circular fields: every obstacle is thought to carry a current whose magnetic field turns a moving charge.
// The force is perpendicular to the velocity: it does no work, so it can neither speed a hand up nor leave it
// in a minimum of a potential, as repulsion does.
namespace multipanda::circular_field {

// A sphere that moves.
struct Ball {
  Vector3 position = Vector3::Zero();  // [m]
  Vector3 velocity = Vector3::Zero();  // [m/s]
  double radius = 0;                   // [m]
};

struct FieldGains {
  double cruise = 0.4;      // speed that the attraction asks for [m/s]
  double approach = 1.5;    // k_p: near its goal a hand asks for k_p times the distance [1/s]
  double pull = 6.0;        // k_v: how fast the velocity follows what is asked for [1/s]
  double range = 0.25;      // clearance below which an obstacle turns a hand [m]
  double turn_rate = 12.0;  // of the velocity where the surfaces touch [rad/s]
  double clearance = 0.03;  // kept to every obstacle, other hand and wall [m]
  double braking = 6.0;     // k_b: a gap h to that clearance may close at k_b h at most [1/s]
};

// k_v (v_d - v) with v_d towards the goal: cruise speed, less near it [m/s^2].
Vector3 attraction(const FieldGains& gains, const Vector3& to_goal, const Vector3& velocity);

// Where to pass an obstacle: the unit vector from its centre to the hand at their closest approach, if both
// go on as they do. Head on there is no such side; then `preferred` (unit length or zero) decides, and if
// that says nothing either, a fixed rule that gives two hands meeting each other opposite sides.
Vector3 passing_side(const Ball& hand, const Ball& obstacle, const Vector3& preferred);

// The circular field of one obstacle: F = v x (c x v) Omega / |v|, c the passing side. Omega, the turn rate
// of the velocity, grows with the square of the nearness and is zero out of range and when the two part. F is
// perpendicular to v. [m/s^2]
Vector3 circular_force(const FieldGains& gains, const Ball& hand, const Ball& obstacle, const Vector3& side);

// A half-space of accelerations: normal . a >= bound.
struct Barrier {
  Vector3 normal = Vector3::UnitX();
  double bound = 0;
};

// Keeps the gap h between two balls: with k_b of the gains, h'' + 2 k_b h' + k_b^2 h >= 0, so that h decays
// no faster than a critically damped motion and never changes sign. `share` of it is this hand's: 1 for an
// obstacle, 1/2 for another hand, which sees to the other half.
Barrier ball_barrier(const FieldGains& gains, const Ball& hand, const Ball& obstacle, double share);
// The same for a wall at `distance` from the hand's centre, `inward` its unit normal.
Barrier wall_barrier(const FieldGains& gains, const Ball& hand, double distance, const Vector3& inward);

// The acceleration nearest to `wanted` that all barriers allow (Hildreth's method: a few sweeps over the
// barriers; `multipliers` is scratch, one number per barrier).
Vector3 nearest_allowed(const Vector3& wanted, std::span<const Barrier> barriers,
                        std::span<double> multipliers);

}  // namespace multipanda::circular_field
