#pragma once

#include <limits>

// One coordinate of a desired motion that follows a reference within limits. Stateless, any thread, no
// allocation. Separate from FollowingMotion (core/controllets), which limits lengths of vectors: an arm's
// interface checks the backward differences of each coordinate, and its ranges.
namespace multipanda {

// Of one coordinate, in its unit u (rad, m) per s, s^2, s^3.
struct AxisLimits {
  double velocity = 0, acceleration = 0, jerk = 0;  // > 0
  // Largest velocity, in addition to the reference's, for reducing the distance to the reference: jumps are
  // approached slowly.
  double catch_up = 0;  // [u/s]
  // The range of positions. Towards an end, at the distance d from it, the velocity is at most
  // sqrt(2 deceleration d + offset^2) - offset. Beyond an end only a return is possible, on request.
  double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();
  double deceleration = 1, offset = 0.1;  // > 0 [u/s^2, u/s]
};

// Differences used by the arm: backward over one period, so v = (x - x_before) / T, a = (v - v_before) / T.
struct AxisState {
  double x = 0, v = 0, a = 0;
};

// Bandwidth of the followers: three (velocity: two) equal poles at this place, without oscillation. A
// reference of constant velocity is followed without lag, an acceleration a with the distance 3 a / w^2.
// Noise of the size n on a position makes a jerk of about w^3 n.
inline constexpr double kFollowerBandwidth = 150;  // [rad/s]

// One period towards the reference, which is at `x_d` at the end of the period and moves at `v_d`. Velocity,
// acceleration and jerk stay within the limits whatever the reference does.
void follow_position(const AxisLimits& limits, double x_d, double v_d, AxisState& state) noexcept;
// One period towards a velocity; 0 stops within the limits.
void follow_velocity(const AxisLimits& limits, double v_d, AxisState& state) noexcept;

// The velocities that the limits allow at x.
double upper_velocity(const AxisLimits& limits, double x) noexcept;
double lower_velocity(const AxisLimits& limits, double x) noexcept;

}  // namespace multipanda
