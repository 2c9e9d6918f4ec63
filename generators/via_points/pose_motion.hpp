#pragma once

#include <span>
#include <vector>

#include "core/types/spatial.hpp"
#include "generators/via_points/quintic_piece.hpp"

// Motions of a pose, planned as a whole before they begin: as joint_motion.hpp, for hands. Throws
// std::invalid_argument, with what was expected, for what cannot be planned. Knows no arm: whether an arm can
// reach the poses is not asked.
namespace multipanda {

// Magnitudes (Euclidean norms) that a motion stays within, above 0.
struct PoseMotionLimits {
  double speed = 0.5;               // [m/s]
  double acceleration = 3;          // [m/s^2]
  double jerk = 60;                 // [m/s^3]
  double angular_speed = 1.0;       // [rad/s]
  double angular_acceleration = 6;  // [rad/s^2]
  double angular_jerk = 120;        // [rad/s^3]
};

// A pose in W, its velocity and acceleration at its own origin in the axes of W: twist and its rate.
struct PoseSample {
  Pose X;
  Twist V, A;
};

// A motion of a pose from t = 0 to duration(). A value.
class PoseMotion {
 public:
  // A polynomial in position and in a rotation vector r about where the piece's orientations are counted
  // from: R(t) = exp(r(t)) R_0.
  struct Piece {
    Matrix3 R_0 = Matrix3::Identity();
    QuinticPiece path;  // six coordinates
    PoseSample evaluate(double t) const;
  };

  explicit PoseMotion(const Pose& rest);
  PoseMotion(const Pose& start, std::vector<Piece> pieces, std::vector<double> knots);

  double duration() const { return starts_.back(); }  // [s]
  // At t [s] since the start; before it and after the end the motion rests. Does not allocate.
  PoseSample sample(double t) const;
  // One time per via point, in their order [s].
  const std::vector<double>& knots() const { return knots_; }
  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  Pose start_, end_;
  std::vector<Piece> pieces_;
  std::vector<double> starts_, knots_;
};

// Through every via point without a stop, to rest at the last one. Position and orientation are continuous up
// to their accelerations. Rotations take the short way from one via point to the next, which must be less
// than pi - 0.01 rad. Straight between two via points at rest; in between the path is curved, and slower the
// sharper the bend: it stops where the motion turns back. The same motion whatever frame the poses are given
// in. Within `scale` (0 < scale <= 1) times the limits. A start that moves is braked to rest first; via
// points equal to the one before take no time.
PoseMotion pose_via_motion(const PoseSample& start, std::span<const Pose> via, const PoseMotionLimits& limits,
                           double scale = 1);

// A smooth stop within `scale` times the limits of acceleration and jerk.
PoseMotion pose_brake(const PoseSample& from, const PoseMotionLimits& limits, double scale = 1);

}  // namespace multipanda
