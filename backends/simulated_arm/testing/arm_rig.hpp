#pragma once

// For tests: a simulated arm on the simplest plant: rigid bodies that can be pushed.
#include <Eigen/Cholesky>

#include "backends/simulated_arm/simulated_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::test {

struct ArmRig {
  static constexpr double dt = 0.001;

  explicit ArmRig(const std::string& robot_name, const Pose& X_WB = {}, PlantFidelity fidelity = {},
                  std::optional<SetCollisionThresholds> thresholds = {}, bool hand = true)
      : ArmRig(config_of(robot_name, X_WB, std::move(fidelity), std::move(thresholds), hand)) {}
  explicit ArmRig(const SimulatedArmConfig& config)
      : arm(config, config.model->q_home()),
        body(config.model),
        q(config.model->q_home()),
        dq(joint_constant(config.model->joint_count(), 0)),
        tau_on_arm(dq) {
    body.set_config(config.frames, config.tool, config.load);
    const JointVector tau = arm.motor_torque(q, dq, 0);
    arm.measure({.q = q, .dq = dq, .tau_link = tau});
  }

  static SimulatedArmConfig config_of(const std::string& robot_name, const Pose& X_WB, PlantFidelity fidelity,
                                      std::optional<SetCollisionThresholds> thresholds, bool hand) {
    const RobotDescription robot = load_robot(robot_name);
    const bool has_hand = hand && robot.hand.has_value();
    SimulatedArmConfig config;
    config.model = std::make_shared<const ArmModel>(arm_model_source(robot, X_WB, has_hand));
    if (has_hand) config.frames.X_FE = robot.hand->mount.pose() * robot.hand->tcp.pose();
    config.plant = std::move(fidelity);
    config.thresholds = std::move(thresholds);
    config.motion_limits = MotionLimits::of(robot);
    return config;
  }

  // Advances by one period with the given command.
  void step() {
    const JointVector tau = arm.motor_torque(q, dq, dt);
    body.update(q, dq);
    const JointVector pushed = tau_on_arm + body.J_V_WK().transpose() * F_K_W_on_arm.vector;
    dq += dt * JointVector(body.M().llt().solve(tau + pushed - body.c() - body.g()));
    q += dt * dq;
    arm.measure({.q = q, .dq = dq, .tau_link = tau});
  }
  void steps(int count) {
    for (int k = 0; k < count; ++k) step();
  }
  void torque(const JointVector& tau) {
    arm.take_command(tau);
    step();
  }
  // Approaches the torque by at most 1 N m per period, then applies it for `more` periods.
  void lead_to(const JointVector& tau, int more = 0) {
    while (now != tau) {
      now += (tau - now).cwiseMax(-1).cwiseMin(1);
      torque(now);
    }
    for (int k = 0; k < more; ++k) torque(now);
  }
  void command(const InterfaceCommand& c) {
    arm.take_command(c);
    step();
  }
  // A program that holds the arm at q_0 by torques, for `count` periods.
  void hold_by_torque(const JointVector& q_0, int count) {
    for (int k = 0; k < count; ++k) {
      body.update(q, dq);
      const JointVector inertia = body.M().diagonal();
      const JointVector stiffness = (150 * 150 * inertia).cwiseMin(300);
      const JointVector damping = 1.6 * stiffness.cwiseProduct(inertia).cwiseSqrt();
      const JointVector requested = stiffness.cwiseProduct(q_0 - q) - damping.cwiseProduct(dq);
      now += (requested - now).cwiseMax(-1).cwiseMin(1);
      torque(now);
    }
  }
  // The same while the push on K, or on joints, grows linearly to the given value.
  void push_while_held(const JointVector& q_0, const Vector3& f_W, const JointVector& tau, int count) {
    const Vector3 f = F_K_W_on_arm.force();
    const JointVector t = tau_on_arm;
    for (int k = 1; k <= count; ++k) {
      F_K_W_on_arm.force() = f + (f_W - f) * k / count;
      tau_on_arm = t + (tau - t) * k / count;
      hold_by_torque(q_0, 1);
    }
  }
  JointVector zero() const { return joint_constant(static_cast<std::size_t>(q.size()), 0); }
  const ArmState& state() const { return arm.state(); }
  const InterfaceState& face() const { return arm.interface(); }

  SimulatedArm arm;
  ModelTerms body;
  JointVector q, dq;
  JointVector tau_on_arm;  // [N m] (n x 1)
  Wrench F_K_W_on_arm;     // at K, world axes
  JointVector now = dq;    // torque commanded last
};

inline SetCollisionThresholds thresholds_of(std::size_t n, double torque_lower, double torque_upper,
                                            double wrench_lower, double wrench_upper) {
  return {.nominal = {.torque_lower = joint_constant(n, torque_lower),
                      .torque_upper = joint_constant(n, torque_upper),
                      .wrench_lower = Vector6::Constant(wrench_lower),
                      .wrench_upper = Vector6::Constant(wrench_upper)},
          .acceleration = {}};
}

inline const std::string kSixAxes = std::string(MULTIPANDA_SOURCE_DIR) + "/tests/models/ur5e.yaml";

}  // namespace multipanda::test
