#pragma once

#include <array>
#include <functional>
#include <limits>
#include <vector>

#include "core/types/joints.hpp"

// The polynomials of degree five from which all planned motions are made. Evaluation does not allocate.
namespace multipanda {

// A polynomial of degree five of the time since its start, for one coordinate.
struct Quintic {
  struct State {
    double position = 0, velocity = 0, acceleration = 0;
  };
  std::array<double, 6> c{};  // coefficients of 1, t, ... t^5

  // The polynomial that goes from one state to another in duration_s > 0.
  static Quintic between(const State& from, const State& to, double duration_s);
  State at(double t) const;
};

// Coordinates (joints; or x y z and a rotation vector), their velocities and accelerations. Each (n x 1).
struct JointSample {
  JointVector position, velocity, acceleration;
};

// One polynomial per coordinate over [0, duration].
struct QuinticPiece {
  double duration = 0;   // [s], above 0
  std::size_t size = 0;  // coordinates
  std::array<Quintic, kMaxJoints> coordinates{};

  static QuinticPiece between(const JointSample& from, const JointSample& to, double duration_s);

  // t in [0, duration].
  void evaluate(double t, JointSample& out) const;
};

// A piece for the values of a set-point. It ends in the goal with a given velocity and acceleration (0 by
// default), and stays at the goal afterwards. Between two rests it is the minimum-jerk motion.
class QuinticSegment {
 public:
  using Values = std::array<double, kMaxTargetValues>;
  struct Sample {
    Values position{}, velocity{}, acceleration{};
  };

  // duration_s <= 0: at the goal at once.
  void plan(std::size_t size, const Sample& start, const Values& goal, double duration_s,
            const Values& end_velocity = {}, const Values& end_acceleration = {});
  void evaluate(double t, Sample& out) const;
  double duration() const { return piece_.duration; }
  std::size_t size() const { return piece_.size; }

 private:
  static_assert(kMaxTargetValues <= kMaxJoints);
  QuinticPiece piece_;
  Values goal_{};
};

// The minimum-jerk step s(u) = 6u^5 - 15u^4 + 10u^3 from 0 to 1, its slope and its integral, u in [0, 1].
struct MinimumJerkStep {
  double value, slope, integral;
};
inline MinimumJerkStep minimum_jerk_step(double u) {
  const double u2 = u * u, u3 = u2 * u;
  return {u3 * (10 + u * (6 * u - 15)), 30 * u2 * (1 - u) * (1 - u), u3 * u * (2.5 + u * (u - 3))};
}

// Exact extremes of a piece, (n x 1) each; velocity, acceleration and jerk as magnitudes.
struct JointPeaks {
  JointVector lowest, highest, velocity, acceleration, jerk;
  void include(const JointPeaks& other);
};
JointPeaks peaks_of(const QuinticPiece& piece);

// The quickest stop within limits of acceleration and jerk, each coordinate for itself: constant jerk,
// constant acceleration, constant jerk. It begins with the sample's acceleration. Where that is beyond the
// limit, it first returns to the limit. It ends at rest. Empty if the sample is at rest.
std::vector<QuinticPiece> stopping_pieces(const JointSample& from, const JointVector& acceleration_limit,
                                          const JointVector& jerk_limit);

// The factor by which a piece must be stretched in time to stay within limits, from its ratios of velocity,
// acceleration and jerk to their limits: the largest of v, a^1/2 and j^1/3.
double stretch_for(double velocity_ratio, double acceleration_ratio, double jerk_ratio);

// The shortest duration [s] of the minimum-jerk motion from rest to rest over a distance within limits: its
// peaks are 15/8 d/T, 10/sqrt(3) d/T^2 and 60 d/T^3.
double rest_to_rest_duration(double distance, double velocity,
                             double acceleration = std::numeric_limits<double>::infinity(),
                             double jerk = std::numeric_limits<double>::infinity());
// The highest speed of that motion over a distance in a duration.
inline double rest_to_rest_speed(double distance, double duration) { return 1.875 * distance / duration; }

// Durations of successive pieces that use their limits well. `stretches` returns, for given durations, the
// factor by which each piece must be stretched (stretch_for). It must scale as time does when all durations
// are scaled alike. Begins at `first`, adapts each duration in a fixed number of rounds, and returns the
// shortest total found, with all pieces within limits.
std::vector<double> shortest_durations(
    std::vector<double> first,
    const std::function<std::vector<double>(const std::vector<double>&)>& stretches);

}  // namespace multipanda
