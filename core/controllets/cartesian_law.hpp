#pragma once

#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/controllets/task_spring.hpp"

// Cartesian impedance of one arm, shared by all Cartesian controllets. Loop thread, no allocation.
namespace multipanda {

enum class Projector : std::uint8_t {
  dynamic,             // N = I - J^T J_bar^T: the null-space torque does not accelerate the end effector
  paper_pseudoinverse  // N = (I - J^+ J)^T, as in the paper: accelerates the end effector through the
                       // coupling of M
};
enum class StiffnessAxes : std::uint8_t {
  world,
  end_effector  // of the set-point's end effector: fixed while the target is, so that the spring is a
                // potential
};

struct ImpedanceGains {
  Vector3 translational_stiffness;  // [N/m]
  Vector3 rotational_stiffness;     // [N m/rad]
  double damping_ratio = 1;         // zeta
  StiffnessAxes axes = StiffnessAxes::world;
  bool acceleration_feedforward = true;
  ContactBounds contact = ContactBounds::lifted();

  TaskStiffness stiffness(const Matrix3& R_W_d) const;  // world axes, for the set-point's orientation
};

struct NullSpaceGains {
  double stiffness = 0;      // K_N [N m/rad]
  double damping_ratio = 1;  // of D_N
  Projector projector = Projector::dynamic;
  ContactBounds contact = ContactBounds::lifted();
};

struct CartesianTarget {
  Pose X_W_d;
  Twist V_d, A_d;  // of the set-point, world axes

  static CartesianTarget of(const Reference& pose) {
    return {pose.pose(), pose.twist(), pose.acceleration()};
  }
};

// Forces of the law on one frame: world axes, at the origin of the frame.
struct TaskForce {
  Vector6 error;                   // pose_error(X_d, X)
  Vector6 spring;                  // gradient part [N, N m]; less what the bounds for contact take away
  Vector6 total;                   // spring + D (V_d - V) + Lambda A_d
  Vector6 pull = Vector6::Zero();  // total without damping, before the bounds
  BoundedPull bounded;

  // Tells the reference of this hand's set-point.
  void report(Reference& reference) const {
    reference.resist(pull, bounded.force_share, bounded.moment_share);
  }
};

// K_c x~ + D_c (V_d - V) + Lambda A_d with D_c by task_damping(Lambda, K_c, zeta).
TaskForce impedance_force(const ImpedanceGains& gains, const CartesianTarget& target, const Pose& X,
                          const Vector6& V, const Matrix6& Lambda);

// tau_null = N (K_N (q_N - q) - D_N N^T dq), D_N = 2 zeta sqrt(K_N diag M). With N^T, the damping is
// dissipative for any projector; -D_N dq inside N is not. Bounded in singular poses: the eigenvalues of N
// stay within [0, 1]. Near a singular pose, the dynamic projector leaves a part of the spring that presses
// with the hand (TaskSpace::press); within bounds for contact, the spring is scaled down until that is a
// twentieth of theirs. `spring_share` scales the spring only; D_N is designed for the full spring.
JointVector null_space_torque(const NullSpaceGains& gains, OwnedArm& arm, const JointVector& q_N,
                              double spring_share = 1);

// The complete law: tau = J^T F + tau_null + C dq. Returns fault if the torque is not finite.
LawResult cartesian_impedance_law(const ImpedanceGains& gains, const NullSpaceGains& null_space,
                                  const CartesianTarget& target, OwnedArm& arm, const JointVector& q_N,
                                  TaskForce& force);

// --- descriptor parts that Cartesian controllets share ---
enum CartesianParameter : std::size_t {
  kTranslationalStiffness,
  kRotationalStiffness,
  kCartesianDampingRatio,
  kStiffnessAxes,
  kAccelerationFeedforward,
  kNullSpaceStiffness,
  kProjector,
  kCartesianParameterCount
};
using CartesianParameters = SpecsAt<ParameterSpec, 0, kCartesianParameterCount>;
CartesianParameters cartesian_parameters();
ImpedanceGains impedance_gains(const ParameterSet& parameters,
                               const ContactBounds& contact = ContactBounds::lifted());
NullSpaceGains null_space_gains(const ParameterSet& parameters, const ContactBounds& contact);

// Outputs of one arm: error 3 + 3, wrench 3 + 3; `prefix` is "" or "first_".
inline constexpr std::size_t kCartesianOutputSize = 12;
using CartesianOutputs = SpecsAt<OutputSpec, 0, kCartesianOutputSize>;
CartesianOutputs cartesian_outputs(const std::string& prefix = "");
void show(const TaskForce& force, std::span<double> outputs);

}  // namespace multipanda
