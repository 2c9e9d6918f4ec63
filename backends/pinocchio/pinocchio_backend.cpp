#include "backends/pinocchio/pinocchio_backend.hpp"

#include <stdexcept>

#include <Eigen/Cholesky>

#include "backends/simulated_arm/friction.hpp"
#include "backends/simulated_arm/from_scene.hpp"
#include "core/types/time.hpp"
#include "models/arm_source.hpp"
#include "scene/build.hpp"

namespace multipanda {

PinocchioBackend::PinocchioBackend(const Scene& scene, bool paced)
    : paced_(paced), substeps_(checked_substeps(scene)) {
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const SceneArm& arm = scene.arms[i];
    const RobotDescription robot = plant_robot_of(arm);
    if (robot.link_friction) {
      throw std::invalid_argument("arm '" + arm.name +
                                  "': friction beyond the torque sensor (link_friction of '" + robot.name +
                                  "') is simulated by MuJoCo only");
    }
    const SimulatedArmConfig config = simulated_arm_config(scene, i);
    arms_.push_back({.behavior = SimulatedArm(config, arm.q_start),
                     .plant = ModelTerms(std::make_shared<const ArmModel>(
                         arm_model_source(robot, plant_base_of(arm, robot), arm.hand))),
                     .friction = friction_of(scene, robot),
                     .motor_inertia = robot.motor_inertia,
                     .q_start = arm.q_start,
                     .q = arm.q_start,
                     .dq = joint_constant(config.model->joint_count(), 0),
                     .measurement = {}});
    arms_.back().plant.set_config(config.frames, arm.tool, arm.load_present);
    arms_.back().measurement.tau_link = arms_.back().dq;
    measure(arms_.back());
  }
}

Capabilities PinocchioBackend::capabilities(ArmIndex) const {
  return {.simulated = true, .lockstep = true, .every_command_arrives = true};
}

void PinocchioBackend::start() {
  if (paced_) requests_.refuse_after_gaps();
  requests_.open();
  pacer_.start();
}

void PinocchioBackend::finish() {
  for (auto& arm : arms_) arm.behavior.stop_motion();
  requests_.close();
}

ArmSet PinocchioBackend::wait() {
  if (paced_ || paused_) pacer_.wait();
  advance();
  take_requests();
  return ArmSet::all(arms_.size());
}

void PinocchioBackend::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (due.contains(i)) states[i] = arms_[i].behavior.state();
  }
}

void PinocchioBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  if (paused_) return;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (due.contains(i)) {
      arms_[i].behavior.take_command(commands[i].tau_cmd);
    } else {
      arms_[i].behavior.miss_command();
    }
  }
  commanded_ = true;
}

// The period started by the last write().
void PinocchioBackend::advance() {
  if (!commanded_) return;
  commanded_ = false;
  for (auto& arm : arms_) {
    arm.measurement.tau_link.setZero();
    for (std::size_t k = 0; k < substeps_; ++k) step(arm, kArmPeriod / static_cast<double>(substeps_));
    measure(arm);
  }
  ++periods_;
}

PinocchioBackend::Rates PinocchioBackend::rates(Arm& arm, const JointVector& q, const JointVector& dq,
                                                const JointVector& tau_motor) {
  arm.plant.update(q, dq);
  JointVector tau = tau_motor - arm.plant.c() - arm.plant.g();
  if (arm.friction) {
    for (Eigen::Index j = 0; j < tau.size(); ++j) {
      tau[j] -= friction_torque(*arm.friction, static_cast<std::size_t>(j), dq[j]);
    }
  }
  if (arm.motor_inertia.size() == 0) return {dq, arm.plant.M().llt().solve(tau)};
  JointMatrix inertia = arm.plant.M();
  inertia.diagonal() += arm.motor_inertia;
  return {dq, inertia.llt().solve(tau)};
}

void PinocchioBackend::step(Arm& arm, double dt) {
  const JointVector tau = arm.behavior.motor_torque(arm.q, arm.dq, dt);
  const Rates k1 = rates(arm, arm.q, arm.dq, tau);
  const Rates k2 = rates(arm, arm.q + 0.5 * dt * k1.dq, arm.dq + 0.5 * dt * k1.ddq, tau);
  const Rates k3 = rates(arm, arm.q + 0.5 * dt * k2.dq, arm.dq + 0.5 * dt * k2.ddq, tau);
  const Rates k4 = rates(arm, arm.q + dt * k3.dq, arm.dq + dt * k3.ddq, tau);
  const JointVector dq_before = arm.dq;
  arm.q += dt / 6 * (k1.dq + 2 * k2.dq + 2 * k3.dq + k4.dq);
  arm.dq += dt / 6 * (k1.ddq + 2 * k2.ddq + 2 * k3.ddq + k4.ddq);
  arm.measurement.tau_link += tau / static_cast<double>(substeps_);
  if (arm.motor_inertia.size() > 0) {
    arm.measurement.tau_link -= arm.motor_inertia.cwiseProduct(arm.dq - dq_before) / kArmPeriod;
  }
  if (!arm.friction) return;
  for (Eigen::Index j = 0; j < tau.size(); ++j) {
    arm.measurement.tau_link[j] -= friction_torque(*arm.friction, static_cast<std::size_t>(j), arm.dq[j]) /
                                   static_cast<double>(substeps_);
  }
}

void PinocchioBackend::measure(Arm& arm) {
  arm.measurement.q = arm.q;
  arm.measurement.dq = arm.dq;
  // Before the first period, motors support the arm.
  if (periods_ == 0 && !commanded_ && arm.measurement.tau_link.isZero()) {
    arm.measurement.tau_link = arm.behavior.motor_torque(arm.q, arm.dq, 0);
  }
  arm.behavior.measure(arm.measurement);
}

std::future<RequestAnswer> PinocchioBackend::request(ArmIndex arm, ArmRequest request) {
  if (arm >= arms_.size()) {
    return refuse_request(no_such_arm(arm, arms_.size()));
  }
  if (auto why = check_request(request, arms_[arm].behavior.model()); !why.empty()) {
    return refuse_request(std::move(why));
  }
  return requests_.post({.arm = arm, .request = std::move(request)});
}

std::future<RequestAnswer> PinocchioBackend::request(WorldRequest request) {
  return requests_.post({.request = std::move(request)});
}

void PinocchioBackend::take_requests() {
  while (const auto* posted = requests_.front()) {
    const auto* of_world = std::get_if<WorldRequest>(&posted->request);
    requests_.answer(of_world != nullptr
                         ? apply(*of_world)
                         : arms_[posted->arm].behavior.apply(std::get<ArmRequest>(posted->request)));
  }
}

ArmReply PinocchioBackend::apply(const WorldRequest& request) {
  if (std::holds_alternative<ResetSimulation>(request)) {
    reset();
    return ArmReply::done;
  }
  if (const auto* pause = std::get_if<PauseSimulation>(&request)) {
    if (pause->paused && !paused_ && !paced_) pacer_.start();
    paused_ = pause->paused;
    return ArmReply::done;
  }
  return ArmReply::not_supported;
}

void PinocchioBackend::reset() {
  for (auto& arm : arms_) {
    arm.q = arm.q_start;
    arm.dq.setZero();
    arm.behavior.reset(arm.q_start);
    arm.measurement.tau_link = arm.behavior.motor_torque(arm.q, arm.dq, 0);
    measure(arm);
  }
}

}  // namespace multipanda
