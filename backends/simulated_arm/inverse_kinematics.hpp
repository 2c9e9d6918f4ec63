#pragma once

#include <array>
#include <memory>
#include <optional>

#include "arm_interface/arm_interface.hpp"
#include "core/model/arm_model.hpp"

// Kinematics of one arm from base to end effector, without masses, for many evaluations per period. B the
// base, F the flange, E the end effector; all in the axes of B.
namespace multipanda {

class KinematicChain {
 public:
  // Takes the joints' positions and axes from the model. Any number of revolute and prismatic joints.
  explicit KinematicChain(const std::shared_ptr<const ArmModel>& model);

  std::size_t joint_count() const { return joint_count_; }
  void set_end_effector(const Pose& X_FE) { X_TE_ = X_TF_ * X_FE; }

  // X_BE at q (n x 1). No allocation, about 0.1 us.
  Pose X_BE(const JointVector& q) const;
  // The same, and J_V_BE of E's origin: V_BE = J_V_BE dq, linear first (6 x n).
  Pose X_BE(const JointVector& q, Jacobian& J_V_BE) const;

 private:
  std::size_t joint_count_;
  // Frame of joint i, rotated so that z is its axis, in that of joint i - 1 (of B, for the first).
  std::array<Pose, kMaxJoints> X_PT_;
  std::array<bool, kMaxJoints> slides_{};
  Pose X_TF_, X_TE_;  // flange and end effector in the last of these frames
};

// The elbow of a seven-joint arm: {q3, side of joint 4}; +1 above kElbowFlip, -1 below, 0 on it. There the
// centers of shoulder, elbow and wrist lie on one line, and the elbow has no side. Arms with another number
// of joints have no elbow: {0, 0}.
inline constexpr double kElbowFlip = -0.467002423653011;  // [rad]
Elbow elbow_of(const JointVector& q);

// Joint angles for a pose of the end effector, starting from those of the previous period: the solution
// follows the motion and stays on its branch.
//
// Newton's method on the six equations of the pose, and a seventh q3 = elbow where the elbow is given. With A
// their Jacobian and e the error, each round moves the joints by
//   A^T (A A^T + lambda^2 I)^-1 e,   lambda = kDamping:
// the least joint motion where joints are left free (no elbow given, or an arm with more joints).
//
// Near singular poses the damping bounds the motion to |e| / (2 lambda) and each round to kLargestStep; there
// the rounds may not reach the pose (Solution::met = false), and q is the last iterate. The joint velocities
// then exceed all limits. Fewer than six joints: the least-squares pose; `met` only if the pose is reachable.
//
// Deterministic; no allocation; one period's motion takes two or three rounds (a few microseconds), and never
// more than kMostRounds.
class InverseKinematics {
 public:
  static constexpr double kDamping = 1e-5;
  static constexpr double kClosure = 1e-10;    // largest error of a pose that counts as reached [m, rad]
  static constexpr double kLargestStep = 0.1;  // of a joint in one round [rad]
  static constexpr int kMostRounds = 12;
  static constexpr double kSingular = 5e-2;  // see singular()

  explicit InverseKinematics(const std::shared_ptr<const ArmModel>& model) : chain_(model) {}

  void set_end_effector(const Pose& X_FE) { chain_.set_end_effector(X_FE); }
  const KinematicChain& chain() const { return chain_; }

  struct Solution {
    JointVector q;
    bool met = false;
    double error = 0;  // largest remaining error of pose and elbow [m, rad]
    int rounds = 0;
  };
  // `elbow`: q3, only for seven joints. Target and guess must be finite.
  const Solution& solve(const Pose& X_BE, std::optional<double> elbow, const JointVector& q_guess);

  // Joint motion for a small motion of the end effector [m, rad] (and of q3) at the last solution.
  JointVector differential(const Vector6& dX, double delbow) const;

  // True if the end effector can hardly move in some direction: the smallest singular value of J_V_BE, in
  // meters and radians, is below kSingular. Expensive: for the start of a motion.
  bool singular(const JointVector& q) const;

 private:
  using TaskMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 7, kMaxJoints>;
  using TaskVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 7, 1>;
  JointVector joint_motion(const TaskVector& error) const;

  KinematicChain chain_;
  Solution solution_;
  bool with_elbow_ = false;
  Jacobian J_;
};

}  // namespace multipanda
