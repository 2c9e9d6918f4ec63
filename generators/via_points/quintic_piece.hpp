#pragma once

#include <functional>
#include <vector>

#include "core/types/joints.hpp"

// What motions through via points are made of. No clock, no transport; evaluation allocates nothing.
namespace multipanda {

// Coordinates (joints; or x y z and a rotation vector), their rates and the rates of these. Each (n x 1).
struct JointSample {
  JointVector position, velocity, acceleration;
};

// Polynomials of degree five of the time since the piece's start, one per coordinate, over [0, duration].
struct QuinticPiece {
  double duration = 0;  // [s], above 0
  JointBy6 c;           // (n x 6): coefficients of 1, t, ... t^5

  // From one sample to another: both samples' positions, velocities and accelerations are met.
  static QuinticPiece between(const JointSample& from, const JointSample& to, double duration_s);

  // t in [0, duration].
  void evaluate(double t, JointSample& out) const;
};

// Exact extremes of a piece, (n x 1) each; velocity, acceleration and jerk as magnitudes.
struct JointPeaks {
  JointVector lowest, highest, velocity, acceleration, jerk;
  void include(const JointPeaks& other);
};
JointPeaks peaks_of(const QuinticPiece& piece);

// The quickest stop within limits of acceleration and jerk, each coordinate for itself: constant jerk,
// constant acceleration, constant jerk. Begins with the sample's acceleration, even where that is beyond the
// limit (which it then comes back to), and ends with neither velocity nor acceleration. Empty: it rests
// already.
std::vector<QuinticPiece> stopping_pieces(const JointSample& from, const JointVector& acceleration_limit,
                                          const JointVector& jerk_limit);

// By how much a piece must be stretched in time to stay within limits: the largest of v / v_max, (a /
// a_max)^1/2 and (j / j_max)^1/3.
double stretch_for(double velocity_ratio, double acceleration_ratio, double jerk_ratio);

// From rest to rest over a distance, the motion of least jerk (quintic): peaks are 15/8 d/T, 10/sqrt(3) d/T^2
// and 60 d/T^3. The shortest T within limits [s].
double rest_to_rest_duration(double distance, double velocity, double acceleration, double jerk);

// Durations of successive pieces that use limits well. `stretches` says of durations by how much each piece
// would have to be stretched (stretch_for); stretching all of them alike must scale every ratio as time does.
// Begins at `first`, lets each piece breathe a few rounds, and returns the shortest whole found, all within
// limits.
std::vector<double> shortest_durations(
    std::vector<double> first,
    const std::function<std::vector<double>(const std::vector<double>&)>& stretches);

}  // namespace multipanda
