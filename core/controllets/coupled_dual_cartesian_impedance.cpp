#include "core/controllets/coupled_dual_cartesian_impedance.hpp"

#include <algorithm>
#include <array>

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/cooperative_frame.hpp"
#include "core/controllets/damping_design.hpp"

namespace multipanda {
namespace {

enum Input : std::size_t { kPose };
enum Parameter : std::size_t {
  kRelativeTranslational = kCartesianParameterCount,
  kRelativeRotational,
  kRelativeOffset
};

// Estimates of A that are turned apart by more than this have lost their meaning: something slipped or broke.
constexpr double kLargestRelativeAngle = 2.0;  // [rad]

class CoupledDualCartesianImpedance final : public Controllet {
 public:
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
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    const ParameterSet& parameters = *context.parameters;
    OwnedArm& first = context.arms[0];
    OwnedArm& second = context.arms[1];
    const CooperativeFrame frame(first.terms->X_WE(), X_EA_[0], second.terms->X_WE(), X_EA_[1]);
    if (!(frame.relative.tail<3>().norm() < kLargestRelativeAngle)) return LawResult::fault;

    const Vector6& V_1 = first.terms->V_WE().vector;
    const Vector6& V_2 = second.terms->V_WE().vector;
    const CartesianTarget target = CartesianTarget::of(context.inputs[kPose]);
    const ImpedanceGains gains = impedance_gains(parameters);
    const TaskForce absolute = impedance_force(gains, target, frame.X_WA, frame.absolute_velocity(V_1, V_2),
                                               inertia(first, frame.L_a1, second, frame.L_a2));
    const TaskForce relative =
        relative_force(parameters, gains, target, frame, frame.relative_velocity(V_1, V_2),
                       inertia(first, frame.L_r1, second, frame.L_r2));

    const NullSpaceGains null_space = null_space_gains(parameters);
    const std::array F{frame.first_wrench(absolute.total, relative.total),
                       frame.second_wrench(absolute.total, relative.total)};
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
  // What the two hands weigh along one half of the coordinates, the other half free: (L diag(A_i) L^T)^-1.
  static Matrix6 inertia(OwnedArm& first, const Matrix6& L_1, OwnedArm& second, const Matrix6& L_2) {
    Matrix6 mobility;
    mobility.noalias() = L_1 * (first.terms->task().mobility * L_1.transpose());
    mobility.noalias() += L_2 * (second.terms->task().mobility * L_2.transpose());
    bool floored = false;
    return floored_inverse(mobility, floored);
  }

  // F_r, conjugate to V_r: minus the gradient of 1/2 p~_r^T K_t p~_r + 1/2 phi_s^T K_r phi_s, and damping.
  static TaskForce relative_force(const ParameterSet& parameters, const ImpedanceGains& gains,
                                  const CartesianTarget& target, const CooperativeFrame& frame,
                                  const Vector6& V_r, const Matrix6& Lambda_r) {
    ImpedanceGains relative = gains;
    relative.translational_stiffness = parameters.vector3(kRelativeTranslational);
    relative.rotational_stiffness = parameters.vector3(kRelativeRotational);
    const TaskStiffness K = relative.stiffness(target.X_W_d.rotation);
    const Matrix6 D = task_damping(Lambda_r, K.matrix(), gains.damping_ratio);

    const Vector3 p_r_d = target.X_W_d.rotation * parameters.vector3(kRelativeOffset);
    Vector6 V_r_d = Vector6::Zero();  // p_r_d turns with the shared frame
    V_r_d.head<3>() = target.V_d.angular().cross(p_r_d);

    TaskForce force;
    const FadedRotation phi(frame.relative.tail<3>());
    force.error << p_r_d - frame.relative.head<3>(), -frame.relative.tail<3>();
    force.spring.head<3>() = K.translation * force.error.head<3>();
    force.spring.tail<3>() = -(phi.dvalue_dr * (K.rotation * phi.value));
    force.total = force.spring;
    force.total.noalias() += D * (V_r_d - V_r);
    return force;
  }

  std::array<Pose, 2> X_EA_;
  std::array<JointVector, 2> q_N_;
};

std::vector<ParameterSpec> parameters() {
  auto specs = cartesian_parameters();
  specs.push_back({"relative_translational_stiffness_n_per_m",
                   "N/m",
                   3,
                   {400, 400, 400},
                   0,
                   5000,
                   "Between the hands, along x, y, z."});
  specs.push_back({"relative_rotational_stiffness_nm_per_rad",
                   "N m/rad",
                   3,
                   {20, 20, 20},
                   0,
                   300,
                   "Between the hands, about x, y, z."});
  specs.push_back(
      {"relative_offset_m",
       "m",
       3,
       {0.0},
       -0.1,
       0.1,
       "Wanted p_2 - p_1 of the estimates of A, axes of the set-point: what squeezes an object."});
  return specs;
}

std::vector<OutputSpec> outputs() {
  auto specs = cartesian_outputs("absolute_");
  for (auto& output : cartesian_outputs("relative_")) specs.push_back(std::move(output));
  return specs;
}

}  // namespace

ControlletType coupled_dual_cartesian_impedance_controllet() {
  return {
      {.type = "coupled_dual_cartesian_impedance",
       .doc = "CDC: two hands move one shared frame and keep their relation to each other.",
       .arms = 2,
       .inputs = {{.name = "pose",
                   .quantity = Quantity::pose,
                   .arm = 0,
                   .doc = "X_WA set-point of the shared frame A, world; begins midway between the hands with "
                          "the world's axes."}},
       .parameters = parameters(),
       .outputs = outputs()},
      [](ArmModels) -> std::unique_ptr<Controllet> {
        return std::make_unique<CoupledDualCartesianImpedance>();
      }};
}

}  // namespace multipanda
