#pragma once

#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/task_spring.hpp"

// Cartesian impedance of one arm, shared by all Cartesian controllets. Loop thread, no allocation.
namespace multipanda {

class RaisedSpring;

enum class Projector : std::uint8_t {
  dynamic,              // N = I - J^T J_bar^T: the null-space torque does not accelerate the end effector
  paper_pseudoinverse,  // N = (I - J^+ J)^T, as in the paper: accelerates the end effector through the
                        // coupling of M
  damped_pseudoinverse  // the same with J^+ = J^T (J J^T + 0.2^2 I)^-1, as in the reference code: the posture
                        // pulls the hand, most where the hand hardly moves
};
enum class StiffnessAxes : std::uint8_t {
  world,
  end_effector  // of the set-point's end effector: fixed while the target is, so that the spring is a
                // potential
};

struct CartesianTarget {
  Pose X_W_d;
  Twist V_d, A_d;  // of the set-point, world axes

  static CartesianTarget of(const Reference& pose) {
    return {pose.pose(), pose.twist(), pose.acceleration()};
  }
};

struct ImpedanceGains {
  Vector3 translational_stiffness;  // [N/m]
  Vector3 rotational_stiffness;     // [N m/rad]
  double damping_ratio = 1;         // zeta
  StiffnessAxes axes = StiffnessAxes::world;
  bool acceleration_feedforward = true;
  ContactBounds contact = ContactBounds::lifted();
  DampingOf damping_of = DampingOf::error;
  bool damping_given = false;                       // D_c from the two below, in the axes of the stiffness
  Vector3 translational_damping = Vector3::Zero();  // [N s/m]
  Vector3 rotational_damping = Vector3::Zero();     // [N m s/rad]
  bool coriolis_feedforward = false;                // C_c V_d

  Matrix3 axes_at(const Matrix3& R_W_d) const;          // of the stiffnesses, world axes
  TaskStiffness stiffness(const Matrix3& R_W_d) const;  // world axes, for the set-point's orientation
  // Lowers the stiffnesses of the axes with the fastest modes at E, motors that the model states included,
  // until none is faster than kFastestMode. Returns the smallest share that remains.
  double soften(const Matrix3& R_W_d, ModelTerms& terms);
  // Whether every axis has the stiffness to bring the hand back.
  bool leads() const {
    return translational_stiffness.minCoeff() >= kLedFrom && rotational_stiffness.minCoeff() >= kTurnedFrom;
  }
  // The set-point without velocity and acceleration along axes that have no stiffness.
  CartesianTarget led(CartesianTarget target, const Matrix3& R_W_d) const;
  // The damping of those axes for an inertia (6 x 6): kBrake times that.
  Matrix6 brake(const Matrix3& R_W_d, const Matrix6& inertia) const;
  // D_c at E, world axes, for the stiffness K (6 x 6): designed, or given and limited by the inertia.
  Matrix6 damping(const Matrix3& R_W_d, const Matrix6& K, ModelTerms& terms) const;
  Matrix6 given_damping(const Matrix3& R_W_d) const;  // kLeastDampingTime K at least; not limited above

 private:
  Matrix6 coasting(const Matrix3& R_W_d) const;  // the projector on axes without stiffness (6 x 6)
};

// The inertia (6 x 6) at E that a given damping acts on: Lambda, with the motors that the model states.
Matrix6 damped_inertia(ModelTerms& terms);

struct NullSpaceGains {
  double stiffness = 0;      // K_N [N m/rad]
  double damping_ratio = 1;  // of D_N
  Projector projector = Projector::dynamic;
  ContactBounds contact = ContactBounds::lifted();
  bool damping_given = false;
  double damping = 0;              // D_N of every joint, if given [N m s/rad]
  bool damping_of_joints = false;  // -N D_N dq, as printed, in place of -N D_N N^T dq
};

// Forces of the law on one frame: world axes, at the origin of the frame.
struct TaskForce {
  Vector6 error;                   // pose_error(X_d, X), of the set-point of the rule
  Vector6 spring;                  // gradient part [N, N m], after the bounds for contact
  Vector6 total;                   // spring + D (V_d - V) + Lambda A_d [+ C_c V_d]
  Vector6 pull = Vector6::Zero();  // total without damping, before the bounds
  Vector6 damping;                 // D V
  BoundedPull bounded;
  double stiffness_share = 1;  // ImpedanceGains::soften
  double pace = 1;             // RaisedSpring::pace

  // Reports this hand's pull to its reference.
  void report(Reference& reference) const {
    reference.resist(pull, bounded.force_share, bounded.moment_share);
    reference.slow(pace);
  }
};

// K_c x~ + D_c (V_d - V) + Lambda A_d [+ C_c V_d]; with DampingOf::velocity -D_c V. `asked` is limited for
// stability (damping_design.hpp), and where it rises, the set-point that acts is at first nearer than
// `requested` (raised_spring.hpp).
TaskForce impedance_force(const ImpedanceGains& asked, const CartesianTarget& requested, ModelTerms& terms,
                          double dt, RaisedSpring& raised);

// tau_null = N (K_N (q_N - q) - D_N N^T dq), D_N = 2 zeta sqrt(K_N diag M) or given. With N^T, the damping is
// dissipative for any projector; -D_N dq inside N is not, unless N is symmetric and D_N the same for all
// joints. K_N and D_N are limited by the inertia of the self-motion (damping_design.hpp). Bounded in singular
// poses: the eigenvalues of N stay within [0, 1]. Near a singular pose, the dynamic projector leaves a part
// of the spring that presses with the hand (TaskSpace::press); within bounds for contact, the spring is
// scaled down until that is a twentieth of theirs, and until it draws no prismatic joint with more than they
// allow a hand. `spring_share` scales the spring only; D_N is designed for the full spring.
JointVector null_space_torque(const NullSpaceGains& gains, OwnedArm& arm, const JointVector& q_N,
                              double spring_share = 1);

// The complete law: tau = J^T F + tau_null + C dq. Returns fault if the torque is not finite.
LawResult cartesian_impedance_law(const ImpedanceGains& gains, const NullSpaceGains& null_space,
                                  const CartesianTarget& target, OwnedArm& arm, const JointVector& q_N,
                                  double dt, RaisedSpring& raised, TaskForce& force);

// --- descriptor parts shared by Cartesian controllets ---
enum CartesianParameter : std::size_t {
  kTranslationalStiffness,
  kRotationalStiffness,
  kCartesianDampingRatio,
  kStiffnessAxes,
  kAccelerationFeedforward,
  kNullSpaceStiffness,
  kProjector,
  kDampingOf,
  kCartesianDampingDesign,
  kTranslationalDamping,
  kRotationalDamping,
  kNullSpaceDamping,
  kNullSpaceDampingOf,
  kCoriolisFeedforward,
  kCartesianParameterCount
};
using CartesianParameters = SpecsAt<ParameterSpec, 0, kCartesianParameterCount>;
CartesianParameters cartesian_parameters();
// The impedance as the paper prints it: K_c = diag(100, 100, 50, 10, 10, 10), critical D_c on the error, M_c
// A_d, C_c V_d, the pseudo-inverse, D_N on all of dq; `more` is appended.
Preset paper_preset(std::vector<Preset::Value> more = {});
// The impedance of the reference code's example.
Preset reference_preset();
ImpedanceGains impedance_gains(const ParameterSet& parameters,
                               const ContactBounds& contact = ContactBounds::lifted());
NullSpaceGains null_space_gains(const ParameterSet& parameters, const ContactBounds& contact);

// Outputs of one arm: error 3 + 3, wrench 3 + 3, share of the stiffness; `prefix` is "" or "first_".
inline constexpr std::size_t kCartesianOutputSize = 13;
using CartesianOutputs = SpecsAt<OutputSpec, 0, kCartesianOutputSize>;
CartesianOutputs cartesian_outputs(const std::string& prefix = "");
void show(const TaskForce& force, std::span<double> outputs);

}  // namespace multipanda
