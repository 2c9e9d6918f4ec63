#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "core/model/arm_model.hpp"
#include "core/model/base_mount.hpp"
#include "core/model/task_space.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// The model of one arm at one state. Each term is computed on demand, at most once per update. References
// stay valid until the next update.
//
// All terms are in world axes: W is the world, E the end effector, F the flange, K the stiffness frame. Use
// one instance per thread. No call allocates after construction.
class ModelTerms {
 public:
  explicit ModelTerms(std::shared_ptr<const ArmModel> model);
  ~ModelTerms();
  ModelTerms(ModelTerms&&) noexcept;
  ModelTerms& operator=(ModelTerms&&) noexcept;

  // Takes q and dq of the measured state, and its frames, tool and load if config_version changed.
  void update(const ArmState& state);
  // The same from vectors. Frames and loads stay as they are.
  void update(const JointVector& q, const JointVector& dq);
  void set_config(const ArmFrames& frames, const Load& tool, const Load& load);

  // For an arm that stands on another one: takes pose and velocity of its base from the carrier, each cycle
  // after update() of both. Momentum, its drift, V_WE and dJ/dt then count the base's velocity; c() does not,
  // and no term knows the base's acceleration. A carrier whose state is not finite leaves the base where it
  // was, at rest.
  void stand_on(ModelTerms& carrier, const BaseMount& mount);
  // For the carrier, once before the loop: M, c and g include the carried arm as a rigid body of the link
  // behind `joint`, in its present configuration; momentum counts its own motion, too. `carried` must outlive
  // this object. While its state is not finite, it counts as the last known body, fixed to that link.
  void carry(ModelTerms& carried, std::size_t joint);
  const Pose& X_WB() const { return X_WB_; }  // of the base now
  // Torques of the joints up to `joint` that exert the wrench F at the point p_W of a body behind it, J^T F
  // (n x 1), zero for the other joints; world axes.
  JointVector torque_of(std::size_t joint, const Vector3& p_W, const Vector6& F);

  const ArmModel& model() const { return *model_; }
  const std::shared_ptr<const ArmModel>& shared_model() const { return model_; }
  std::size_t joint_count() const { return model_->joint_count(); }
  const JointVector& q() const { return q_; }
  const JointVector& dq() const { return dq_; }

  // Kinematics
  const Pose& X_WF();
  const Pose& X_WE();
  const Pose& X_WK();
  // From E to the flange and to the end of the tool (ArmModel::tool_end), world axes [m].
  std::array<Vector3, 2> points_from_hand();
  const Jacobian& J_V_WE();      // V_WE = J_V_WE dq, at E's origin, world axes (6 x n)
  const Twist& V_WE();           // [m/s, rad/s]
  Pose X_WJ(std::size_t joint);  // frame of joint 0..n-1
  // Linear rows of the Jacobian of a point fixed to the link behind joint `joint` (0..n-1). The point is
  // given in the world [m].
  void point_jacobian(std::size_t joint, const Vector3& p_W,
                      Eigen::Ref<Eigen::Matrix<double, 3, Eigen::Dynamic>> J);

  // Dynamics, with tool and load
  const JointMatrix& M();  // mass matrix (n x n) [kg m^2], with ArmModel::known_motor_inertia
  const JointVector& c();  // C(q, dq) dq (n x 1) [N m]
  const JointVector& g();  // gravity torque that holds the arm still (n x 1) [N m]
  // Generalized momentum p = M dq of the links, and its drift: dp/dt = tau + tau_on_arm + drift, drift = C^T
  // dq - g.
  const JointVector& momentum();        // (n x 1) [N m s]
  const JointVector& momentum_drift();  // (n x 1) [N m]

  Jacobian J_V_WK();  // at the stiffness frame's origin, world axes (6 x n)

  JointVector coriolis_times(const JointVector& v);   // C(q, dq) v by Christoffel symbols (n x 1) [N m]
  Vector6 jacobian_rate_times(const JointVector& v);  // (dJ_V_WE/dt) v (6 x 1)
  // C_c V (6 x 1) [N, N m], C_c = J_bar^T C J_bar - Lambda dJ/dt J_bar: the wrench that a motion of E needs
  // at constant twist V, besides the self-motion. dLambda/dt - 2 C_c is skew on twists.
  Vector6 task_coriolis(const Vector6& V);

  // Task space at E, world axes
  const TaskSpace& task();
  double manipulability();                       // sqrt(det(J J^T)), J = J_V_WE
  const Manipulability& manipulability_terms();  // with its gradient, smoothed at singular poses
  const JointVector& manipulability_gradient() { return manipulability_terms().gradient; }  // (n x 1) [1/rad]

 private:
  enum Term : std::uint32_t {
    kKinematics = 1,
    kJacobian = 2,
    kTwist = 4,
    kInertias = 8,
    kMass = 16,
    kGravity = 32,
    kMotion = 64,
    kTask = 128,
    kManipulability = 256,
    kManipulabilityTerms = 512
  };
  bool first(Term term) {
    if ((done_ & term) != 0) return false;
    done_ |= term;
    return true;
  }
  void place_base(const Pose& X_WB);
  void need_carried();
  void need_kinematics();
  void need_inertias();
  void need_motion();

  std::shared_ptr<const ArmModel> model_;
  struct Scratch;
  std::unique_ptr<Scratch> scratch_;
  ModelTerms* carried_ = nullptr;
  std::size_t carried_joint_ = 0;
  bool base_moves_ = false;
  Pose X_WB_;
  Twist V_WB_;  // of the base, at the world's origin
  std::uint32_t done_ = 0;
  std::uint32_t config_version_ = 0xFFFFFFFF;  // the first state always sets frames and loads
  ArmFrames frames_;

  JointVector q_, dq_;
  Pose X_WF_, X_WE_, X_WK_;
  Jacobian J_V_WE_;
  Twist V_WE_;
  JointMatrix M_;
  JointVector c_, g_, momentum_, momentum_drift_;
  TaskSpace task_;
  double manipulability_ = 0;
  Manipulability manipulability_terms_;
};

}  // namespace multipanda
