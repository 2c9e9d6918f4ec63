#include <algorithm>
#include <array>
#include <cmath>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cooperative_frame.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/offset_reference.hpp"
#include "core/controllets/raised_spring.hpp"

namespace multipanda {
namespace {

// CDC: two hands move one shared frame A and keep their relative pose, as two impedances in the cooperative
// coordinates of core/controllets/cooperative_frame.hpp:
//   [F_1; F_2] = L^T [F_a; F_r],   tau_i = J_i^T F_i + tau_null,i + C_i dq_i
//   [F_a; F_r] = [K_a x~_a; K_r x~_r] + D ([V_a; V_r]_d - [V_a; V_r]) + Lambda [A_a,d; 0]
// with D (12 x 12) designed for the coupled inertia Lambda = L^-T diag(Lambda_1, Lambda_2) L^-1.
// Closed loop at rest: a wrench F on A moves it by K_a^-1 F, a squeeze F_r changes the relative pose by
// K_r^-1 F_r. World axes, linear first; K [N/m, N m/rad]. A begins midway between the hands, with the axes of
// the world; the offsets X_EiA are captured there.
class CoupledDualCartesianImpedance final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {
        .type = "coupled_dual_cartesian_impedance",
        .doc = "CDC: two hands move one shared frame and keep their pose relative to each other.",
        .arms = 2,
        .moving_base = true,
        .wrench_at_hand = true,
        .inputs = spec_table<kInputCount>(input_at<kPose>(shared_frame_input())),
        .parameters = spec_table<kParameterCount>(
            cartesian_parameters(),
            parameter_at<kRelativeTranslational>(relative_translational_stiffness_parameter()),
            parameter_at<kRelativeRotational>(relative_rotational_stiffness_parameter()),
            parameter_at<kRelativeOffset>(
                {.name = "relative_offset_m",
                 .unit = "m",
                 .size = 3,
                 .initial = {0.0},
                 .min = -0.1,
                 .max = 0.1,
                 .doc =
                     "Desired p_2 - p_1 of the two hands' estimates of A, axes of the set-point; a nonzero "
                     "offset squeezes an object. Approached from 0 at half the speed limit of pose."}),
            parameter_at<kRelativeTranslationalDamping>(relative_translational_damping_parameter()),
            parameter_at<kRelativeRotationalDamping>(relative_rotational_damping_parameter())),
        .outputs = spec_table<2 * kCartesianOutputSize>(
            cartesian_outputs("absolute_"), group_at<kCartesianOutputSize>(cartesian_outputs("relative_"))),
        .presets = {coupled_paper_preset()}};
  }

  void start_references(ControlContext& context) override {
    const Pose& X_WE1 = context.arms[0].terms->X_WE();
    const Pose& X_WE2 = context.arms[1].terms->X_WE();
    const Pose X_WA{Matrix3::Identity(), 0.5 * (X_WE1.position + X_WE2.position)};
    X_EA_[0] = X_WE1.inverse() * X_WA;
    X_EA_[1] = X_WE2.inverse() * X_WA;
    context.inputs[kPose].start(X_WA);
  }

  LawResult start(ControlContext& context) override {
    for (std::size_t i = 0; i < 2; ++i) q_N_[i] = context.arms[i].q();
    offset_.start(Vector3::Zero());  // where the hands are
    absolute_ = relative_ = {};
    return LawResult::ok;
  }

  // A stays where it is, at another place in the hand.
  void end_effector_moved(ControlContext& /*context*/, std::size_t arm, const Pose& X) override {
    X_EA_[arm] = X.inverse() * X_EA_[arm];
  }

  LawResult update(ControlContext& context) override {
    const ParameterSet& parameters = *context.parameters;
    OwnedArm& first = context.arms[0];
    OwnedArm& second = context.arms[1];
    const CooperativeFrame frame(first.terms->X_WE(), X_EA_[0], second.terms->X_WE(), X_EA_[1]);
    if (!frame.holds_together()) return LawResult::fault;

    const Vector6& V_1 = first.terms->V_WE().vector;
    const Vector6& V_2 = second.terms->V_WE().vector;
    const Matrix3& R_d = context.inputs[kPose].pose().rotation;
    ImpedanceGains gains = impedance_gains(parameters, context.contact);
    ImpedanceGains relative_gains = gains;
    relative_gains.translational_stiffness = parameters.vector3(kRelativeTranslational);
    relative_gains.rotational_stiffness = parameters.vector3(kRelativeRotational);
    const Matrix12 Lambda = frame.inertia(first.terms->task().Lambda, second.terms->task().Lambda);
    const auto before = absolute_.changed(gains), relative_before = relative_.changed(relative_gains);
    ImpedanceGains was = before.value_or(gains), relative_was = relative_before.value_or(relative_gains);
    const double stiffness_share = soften(frame, first, second, R_d, Lambda, gains, relative_gains);
    const CartesianTarget rule = CartesianTarget::of(context.inputs[kPose]);
    CartesianTarget seen = come_back(absolute_, relative_, rule, context);
    const bool changed = before || relative_before;
    if (changed) {
      soften(frame, first, second, R_d, Lambda, was, relative_was);
      absolute_.raise(was, gains, rule, frame.X_WA, seen);
    }
    const CartesianTarget target = gains.led(seen, R_d);
    const TaskStiffness K_a = gains.stiffness(R_d);
    const TaskStiffness K_r = relative_gains.stiffness(R_d);

    TaskForce absolute, relative;
    absolute.stiffness_share = relative.stiffness_share = stiffness_share;
    absolute.error = pose_error(rule.X_W_d, frame.X_WA);
    absolute.spring = spring_wrench(K_a, pose_error(target.X_W_d, frame.X_WA));
    offset_.advance(parameters.goal_vector3(kRelativeOffset), context.inputs[kPose].spec().max_speed,
                    context.dt);
    const Vector3 p_r_d = R_d * offset_.position();
    relative.error << p_r_d - frame.relative.head<3>(), -frame.relative.tail<3>();
    Vector6 relative_error = relative.error + relative_.offset();
    if (changed) relative_error = relative_.raise(relative_was, relative_gains, R_d, relative_error);
    relative.spring = spring_between(K_r, relative_error);

    // Damping is designed for all twelve coordinates together: a rotation of A moves the whole inertia of
    // both hands if the relative stiffness is high, and little of it if it is low. Separate blocks ignore
    // this coupling.
    Matrix12 K = Matrix12::Zero();
    K.topLeftCorner<6, 6>() = K_a.matrix();
    K.bottomRightCorner<6, 6>() = K_r.matrix();
    Vector12 velocity_error;
    if (gains.damping_of == DampingOf::velocity) {
      velocity_error << -frame.absolute_velocity(V_1, V_2), -frame.relative_velocity(V_1, V_2);
    } else {
      velocity_error << target.V_d.vector - frame.absolute_velocity(V_1, V_2),
          -frame.relative_velocity(V_1, V_2);
      velocity_error.segment<3>(6) += R_d * offset_.velocity();
      velocity_error.segment<3>(6) += target.V_d.angular().cross(p_r_d);  // the offset turns with A
      velocity_error.tail<6>() += relative_.velocity();
    }
    relative_gains.translational_damping = parameters.vector3(kRelativeTranslationalDamping);
    relative_gains.rotational_damping = parameters.vector3(kRelativeRotationalDamping);
    Matrix12 D = gains.damping_given ? given_damping(frame, first, second, gains.given_damping(R_d),
                                                     relative_gains.given_damping(R_d))
                                     : coupled_damping(Lambda, K, gains.damping_ratio);
    if (states_motors(first.model()) || states_motors(second.model()))
      raise_modes(Lambda, Matrix12(kLeastDampingTime * K), D);
    brake(R_d, gains, relative_gains, Lambda, D);
    Vector12 force = D * velocity_error;
    if (gains.acceleration_feedforward) force += Lambda.leftCols<6>() * target.A_d.vector;
    if (gains.coriolis_feedforward) {
      force += frame.task_coriolis(*first.terms, *second.terms, target.V_d.vector);
    }
    absolute.total = absolute.spring + force.head<6>();
    relative.total = relative.spring + force.tail<6>();

    const NullSpaceGains null_space = null_space_gains(parameters, context.contact);
    std::array F{frame.first_wrench(absolute.total, relative.total),
                 frame.second_wrench(absolute.total, relative.total)};
    if (std::isfinite(gains.contact.spring_force + gains.contact.spring_moment)) {
      Vector12 V;
      V << frame.absolute_velocity(V_1, V_2), frame.relative_velocity(V_1, V_2);
      bound(context, frame, D * V, absolute, relative, F);
    }
    for (std::size_t i = 0; i < 2; ++i) {
      OwnedArm& arm = context.arms[i];
      *arm.tau = arm.terms->c() + null_space_torque(null_space, arm, q_N_[i]);
      *arm.tau += arm.terms->J_V_WE().transpose().lazyProduct(F[i]);
      if (!arm.tau->allFinite()) return LawResult::fault;
    }
    show(absolute, context.outputs);
    show(relative, context.outputs.subspan(kCartesianOutputSize));
    return LawResult::ok;
  }

 private:
  enum Input : std::size_t { kPose, kInputCount };
  enum Parameter : std::size_t {
    kRelativeTranslational = kCartesianParameterCount,
    kRelativeRotational,
    kRelativeOffset,
    kRelativeTranslationalDamping,
    kRelativeRotationalDamping,
    kParameterCount
  };
  using Vector12 = Eigen::Matrix<double, 12, 1>;

  // Bounds the pull at each hand. The set-point waits where it moves along the pull on A.
  void bound(ControlContext& context, const CooperativeFrame& frame, const Vector12& damping,
             const TaskForce& absolute, const TaskForce& relative, std::array<Vector6, 2>& F) {
    const std::array damping_at{frame.first_wrench(damping.head<6>(), damping.tail<6>()),
                                frame.second_wrench(damping.head<6>(), damping.tail<6>())};
    double lever = 0, largest = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      const Vector6 pull = F[i] + damping_at[i];
      const BoundedPull bounded =
          bound_pull(context.contact, pull, damping_at[i], context.arms[i].terms->V_WE().linear());
      if (bounded.factor() < 1) F[i] = bounded.remaining(pull) - damping_at[i];
      const double share = std::max(bounded.force_share, bounded.moment_share);
      context.inputs[kPose].resist(absolute.spring, share, share);
      largest = std::max(largest, share);
      const Vector3& p_A = context.inputs[kPose].pose().position;
      lever = std::max(lever, (context.arms[i].terms->X_WE().position - p_A).norm());
    }
    absolute_.resist(absolute.spring, largest, largest, context.dt);
    relative_.resist(relative.spring, largest, largest, context.dt);
    // Each hand moves by half of the offset between them.
    Reference& pose = context.inputs[kPose];
    pose.slow(std::min(absolute_.pace(), relative_.pace()));
    pose.bound_hand_speed(context.contact.hand_speed - 0.5 * offset_.top_speed(pose.spec().max_speed), lever);
  }

  // Conjugate to V_r: minus the gradient of 1/2 p~_r^T K_t p~_r + 1/2 phi_s^T K_r phi_s.
  static Vector6 spring_between(const TaskStiffness& K, const Vector6& error) {
    const FadedRotation phi(-error.tail<3>());
    Vector6 spring;
    spring << K.translation * error.head<3>(), -(phi.dvalue_dr * (K.rotation * phi.value));
    return spring;
  }

  std::array<Pose, 2> X_EA_;
  std::array<JointVector, 2> q_N_;
  OffsetReference offset_;
  RaisedSpring absolute_, relative_;
};

}  // namespace

ControlletType coupled_dual_cartesian_impedance_controllet() {
  return controllet_type<CoupledDualCartesianImpedance>();
}

}  // namespace multipanda
