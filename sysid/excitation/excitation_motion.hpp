#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/reference/harmonic.hpp"
#include "core/types/joints.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// A motion of all joints of an arm that starts and ends at rest in `q_start`.
struct ExcitationMotion {
  JointVector q_start;  // [rad] (n x 1)
  Harmonic series;

  struct Sample {
    JointVector q, dq, ddq;  // (n x 1) [rad], [rad/s], [rad/s^2]
  };
  double duration() const { return series.duration(); }
  std::size_t parts() const { return series.harmonic_count + 1; }
  // Set-point at t from the motion's start, bit-identical to a run's reference.
  Sample at(double t) const;
};

// Search variables of the motion: q_start, then sine and rise per harmonic and joint (n (1 + 2 parts) x 1).
// Period and ramp stay as in `shape`.
Eigen::VectorXd coefficients_of(const ExcitationMotion& motion);
ExcitationMotion with_coefficients(const ExcitationMotion& shape, const Eigen::VectorXd& coefficients);

// Limits of an excitation: fractions of the robot's own limits, distances, and workspace.
struct ExcitationLimits {
  double position_margin = 0.1;  // from each end of a joint's range [rad]
  double velocity_share = 0.6;   // of Franka's limits
  double acceleration_share = 0.6;
  double jerk_share = 0.5;
  double torque_share = 0.7;    // by inverse dynamics, with `payload`
  double self_distance = 0.03;  // between links (capsules), hand and payload [m]
  double reach = 0.25;          // length of a payload of 5 cm radius beyond the flange [m]; 0: none
  double payload = 1.7;         // carried at half of that reach [kg]
  // Space for all moving links, the hand and the reach, in the base frame [m].
  Vector3 room_min{-0.25, -0.9, 0.08}, room_max{0.9, 0.9, 1.3};
};

// How much of a limit a motion uses; 1 is the limit.
struct LimitUse {
  std::string name;  // "velocity"
  double use = 0;
  std::string worst;  // "joint 4: 1.52 rad/s at 3.21 s"
};

// Measures motions of one arm against the limits. One instance per thread.
class MotionCheck {
 public:
  // Throws std::invalid_argument for a robot without these limits.
  MotionCheck(const RobotDescription& robot, bool hand, const ExcitationLimits& limits);

  // All limits at every `step` seconds of the whole motion, ramps included.
  std::vector<LimitUse> use(const ExcitationMotion& motion, double step) const;
  // Sum of (use - 1)^2 over the limits with use above 1, at one state: the penalty of the search.
  double excess(const ExcitationMotion::Sample& sample, const JointVector& jerk) const;

  const JointVector& q_low() const { return q_low_; }  // allowed (n x 1)
  const JointVector& q_high() const { return q_high_; }

 private:
  static constexpr std::size_t kKinds = 7;
  struct Worst {
    double use = 0, value = 0;
    std::size_t part = 0;  // joint, pair or shape
  };
  using Uses = std::array<Worst, kKinds>;
  Uses measure(const ExcitationMotion::Sample& sample, const JointVector& jerk) const;
  std::string words(std::size_t kind, const Worst& worst, double t) const;

  RobotDescription robot_;
  ExcitationLimits limits_;
  JointVector q_low_, q_high_;
  std::shared_ptr<const ArmModel> model_;
  mutable std::unique_ptr<ModelTerms> terms_;
  mutable std::vector<Pose> X_;  // of the model's bodies, base first
};

}  // namespace multipanda
