// End of the simulated arm's period: sensors, estimated forces, checks and published state.
#include <bit>

#include "backends/simulated_arm/simulated_arm.hpp"

namespace multipanda {

void SimulatedArm::measure(const PlantMeasurement& plant) {
  sense(plant);
  if (load_.advance(config_.period_s)) configure_model();
  update_model(state_.q, state_.dq);
  if (estimating_) estimating_->update(state_.q, state_.dq);
  const bool generates = moving_ && motion_.generator != MotionGenerator::none;
  contact_.update(estimating_ ? *estimating_ : model_, state_,
                  generates ? desired_.state().ddq : JointVector(), config_.period_s, settings_.thresholds);
  if (estimates_forces()) {
    state_.tau_ext_hat = contact_.tau_ext_hat();
    state_.F_K_W_est = contact_.F_K_W();
    state_.has_wrench_estimate = true;
  }
  const Pose& X_WB = config_.model->X_WB();
  interface_.X_BE = X_WB.inverse() * model_.X_WE();
  if (moving_ && watching_ && interface_.mode == ArmMode::move) watch_measurement();
  if (!moving_ && hold_changed_) {
    desired_.hold(q_hold_, settings_.frames.X_FE);
    hold_changed_ = false;
  }
  if (recovering_ > 0) --recovering_;
  braking_ = braking_ && !is_at_rest();
  publish_condition();
  publish_interface();
  torque_rate_.publish(state_.tau_J_d);
  follow_due_ = true;
}

void SimulatedArm::sense(const PlantMeasurement& plant) {
  const auto noisy = [this](const JointVector& from, double deviation, JointVector& to) {
    to = from;
    if (deviation <= 0) return;
    for (Eigen::Index i = 0; i < to.size(); ++i) to[i] += deviation * normal_(random_);
  };
  q_motor_ = plant.q;
  if (const JointVector& k = config_.transmission.stiffness; k.size() > 0) {
    q_motor_ += plant.tau_link.cwiseQuotient(k);
  }
  noisy(q_motor_, config_.plant.noise_q_rad, state_.q);
  noisy(plant.dq, config_.plant.noise_dq_rad_per_s, state_.dq);
  interface_.dtau_J = -state_.tau_J / config_.period_s;
  tau_shown_ = plant.tau_link;
  if (config_.torque_sensor) {
    const TorqueSensor& sensor = *config_.torque_sensor;
    if (sensor.gain.size() > 0) tau_shown_ = tau_shown_.cwiseProduct(sensor.gain);
    if (sensor.offset.size() > 0) tau_shown_ += sensor.offset;
  }
  noisy(tau_shown_, config_.plant.noise_tau_nm, state_.tau_J);
  if (sensors_) sensors_->show(state_, config_.period_s);
  interface_.dtau_J += state_.tau_J / config_.period_s;
  state_.tau_J_d = tau_desired_;
  state_.has_contact_truth = plant.has_contact_truth;
  state_.F_K_W_true = plant.F_K_W_true;
  ++state_.sequence;
  state_.t_robot = RobotTime::from_seconds(static_cast<double>(state_.sequence) * config_.period_s);
  state_.t_host = host_now();
}

// All violated rules become errors; the first one is reported in detail.
void SimulatedArm::watch_measurement() {
  const Matrix3 R_BW = config_.model->X_WB().rotation.transpose();
  const Twist& V_WE = model_.V_WE();
  Vector6 V_BE;
  V_BE << R_BW * V_WE.linear(), R_BW * V_WE.angular();
  const bool cartesian = motion_.generator == MotionGenerator::cartesian_pose ||
                         motion_.generator == MotionGenerator::cartesian_velocity;
  const ReflexDetail limit =
      measured_limits_.check({state_.q, state_.dq, state_.tau_J, interface_.X_BE.position, V_BE, cartesian});
  const ReflexDetail itself = self_collision_.check(model_);
  if (limit) raise(limit);
  if (itself) raise(itself);
  if (const ReflexDetail& joint = contact_.joint_collision()) {
    raise(joint);
    interface_.joint_collision = contact_.joint_levels();
  }
  if (const ReflexDetail& axis = contact_.cartesian_collision()) {
    raise(axis);
    interface_.cartesian_collision = contact_.cartesian_levels();
  }
}

// Mode, errors and the motion's modes change together.
void SimulatedArm::publish_condition() {
  state_.mode = interface_.mode = mode();
  state_.errors = interface_.errors = errors_;
  interface_.reflex_reason = state_.report.last_motion_errors = reflex_reason_;
  const bool moves = state_.mode == ArmMode::move;
  interface_.controller = moves ? motion_.controller : ArmController::other;
  interface_.generator = moves ? motion_.generator : MotionGenerator::idle;
  state_.command_success_rate = 0;
  if (moving_ && periods_in_move_ > 0) {
    constexpr std::uint64_t kUpper = (std::uint64_t{1} << 36) - 1;  // 100 - 64 bits
    const int count = std::popcount(received_[0]) + std::popcount(received_[1] & kUpper);
    state_.command_success_rate = static_cast<double>(count) / periods_in_move_;
  }
  interface_.command_success_rate = state_.command_success_rate;
}

void SimulatedArm::publish_desired() {
  const DesiredState& d = desired_.state();
  interface_.q_d = d.q;
  interface_.dq_d = d.dq;
  interface_.ddq_d = d.ddq;
  interface_.X_BE_d = d.X_BE_d;
  interface_.X_BE_c = d.X_BE_c;
  interface_.V_BE_d = d.V_BE_d;
  interface_.V_BE_c = d.V_BE_c;
  interface_.A_BE_c = d.A_BE_c;
  interface_.elbow_d = d.elbow_d;
  interface_.elbow_c = d.elbow_c;
  interface_.delbow_c = d.delbow_c;
  interface_.ddelbow_c = d.ddelbow_c;
}

void SimulatedArm::publish_interface() {
  publish_desired();
  // Without them: rigid joints, or elastic ones that are measured at the motors.
  interface_.theta = sensors_ ? sensors_->theta() : state_.q;
  interface_.dtheta = sensors_ ? sensors_->dtheta() : state_.dq;
  interface_.elbow = elbow_of(state_.q);
  interface_.tau_ext_hat = contact_.tau_ext_hat();
  interface_.F_K_K = contact_.F_K_K();
  interface_.F_B_B = F_B_B_of(contact_.F_K_W(), model_.X_WK().position, config_.model->X_WB());
  interface_.joint_contact = contact_.joint_contact();
  interface_.cartesian_contact = contact_.cartesian_contact();
  publish_report();
}

// The part of the interface sent with the state.
void SimulatedArm::publish_report() {
  const auto raised = [](const auto& levels) {
    unsigned bits = 0;
    for (Eigen::Index i = 0; i < levels.size(); ++i) bits |= (levels[i] != 0 ? 1u : 0u) << i;
    return bits;
  };
  InterfaceReport& report = state_.report;
  report.present = true;
  report.q_d = interface_.q_d;
  report.dq_d = interface_.dq_d;
  report.theta = interface_.theta;
  report.X_BE_d = interface_.X_BE_d;
  report.X_BE_c = interface_.X_BE_c;
  report.elbow = interface_.elbow;
  report.joint_contact = static_cast<std::uint16_t>(raised(interface_.joint_contact));
  report.joint_collision = static_cast<std::uint16_t>(raised(interface_.joint_collision));
  report.cartesian_contact = static_cast<std::uint8_t>(raised(interface_.cartesian_contact));
  report.cartesian_collision = static_cast<std::uint8_t>(raised(interface_.cartesian_collision));
}

}  // namespace multipanda
