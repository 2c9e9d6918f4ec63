#include "backends/simulated_arm/simulated_arm.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/types/overloaded.hpp"

// Modes, motions, commands, requests. The torque path is in simulated_arm_torque.cpp, measurements are
// in simulated_arm_measure.cpp.
namespace multipanda {
namespace {

ArmSettings start_settings(const SimulatedArmConfig& config) {
  ArmSettings settings = default_settings(*config.model);
  settings.frames = config.frames;
  settings.tool = config.tool;
  settings.load = config.load;
  if (config.thresholds) settings.thresholds = *config.thresholds;
  if (config.joint_stiffness) settings.joint_stiffness = *config.joint_stiffness;
  if (config.cartesian_stiffness) settings.cartesian_stiffness = *config.cartesian_stiffness;
  return settings;
}

SimulatedArmConfig checked(SimulatedArmConfig config, const JointVector& q_start) {
  const auto n = static_cast<Eigen::Index>(config.model->joint_count());
  const auto& name = config.model->name();
  if (q_start.size() != n) {
    throw std::invalid_argument("the start configuration of arm model '" + name + "' has " +
                                std::to_string(q_start.size()) + " values, the arm has " + std::to_string(n) +
                                " joints");
  }
  if (config.motion_limits.dq_max.size() != n) {
    throw std::invalid_argument("the motion limits of arm model '" + name + "' are for " +
                                std::to_string(config.motion_limits.dq_max.size()) + " joints, the arm has " +
                                std::to_string(n) + "; take them from MotionLimits::of(robot)");
  }
  for (const Load* load : {&config.tool, &config.load}) {
    if (const auto why = check_load(*load); !why.empty()) throw std::invalid_argument(why);
  }
  if (config.torque_sensor) {
    for (const auto* v : {&config.torque_sensor->gain, &config.torque_sensor->offset}) {
      if (v->size() != 0 && v->size() != n) {
        throw std::invalid_argument("the torque sensor of arm model '" + name + "' is given for " +
                                    std::to_string(v->size()) + " joints, the arm has " + std::to_string(n));
      }
    }
    config.plant.noise_tau_nm = config.torque_sensor->noise;
  }
  const Transmission& t = config.transmission;
  for (const auto* v : {&t.stiffness, &t.ripple, &t.ripple_cycles, &t.ripple_phase}) {
    if (v->size() != 0 && v->size() != n) {
      throw std::invalid_argument("the transmission of arm model '" + name + "' is given for " +
                                  std::to_string(v->size()) + " joints, the arm has " + std::to_string(n));
    }
  }
  if (t.ripple.size() != t.ripple_cycles.size() || t.ripple.size() != t.ripple_phase.size()) {
    throw std::invalid_argument("the ripple of arm model '" + name +
                                "' needs amplitude, cycles and phase of every joint");
  }
  if (t.stiffness.size() > 0 && !(t.stiffness.array() > 0).all()) {
    throw std::invalid_argument("the transmission stiffness of arm model '" + name + "' must be positive");
  }
  if (config.actuation) {
    config.plant.torque_bandwidth_hz = config.actuation->torque_bandwidth_hz;
    config.plant.command_delay_s = config.actuation->command_delay;
    if (!(config.plant.command_delay_s >= 0 && config.plant.command_delay_s <= 1)) {
      throw std::invalid_argument("the command delay of arm model '" + name + "' must be 0 to 1 s");
    }
    return config;
  }
  const double periods = config.plant.command_delay_s / config.period_s;
  if (!(periods >= 0) || std::abs(periods - std::round(periods)) > 1e-6 || periods > 1000) {
    throw std::invalid_argument("the command delay must be a whole number of control periods of " +
                                std::to_string(config.period_s) + " s");
  }
  return config;
}

bool exists(const MotionRequest& request) {
  using Generator = MotionGenerator;
  const bool external = request.controller == ArmController::external;
  if (request.controller == ArmController::other || request.generator == Generator::idle) return false;
  if (request.generator == Generator::none && !external) return false;
  return !request.asynchronous || (request.controller == ArmController::joint_impedance &&
                                   request.generator == Generator::joint_position);
}

// The flag for an invalid command of desired motion.
ArmError no_command(MotionGenerator generator) {
  if (generator == MotionGenerator::cartesian_pose) {
    return ArmError::cartesian_position_motion_generator_invalid_frame;
  }
  return is_cartesian(generator) ? ArmError::cartesian_motion_generator_velocity_discontinuity
                                 : ArmError::joint_motion_generator_velocity_discontinuity;
}

constexpr double kNear = 0.05;  // largest distance at which the arm holds the end of a followed motion [rad]

}  // namespace

SimulatedArm::SimulatedArm(SimulatedArmConfig config, const JointVector& q_start)
    : config_(checked(std::move(config), q_start)),
      settings_(start_settings(config_)),
      start_settings_(settings_),
      model_(config_.model),
      desired_(config_.model, config_.motion_limits),
      controllers_(config_.model->joint_count(), config_.friction, config_.rotor_inertia),
      torque_rate_(config_.model->limits().tau_rate_max, config_.period_s),
      measured_limits_(config_.motion_limits, config_.model->limits().tau_max, config_.workspace),
      self_collision_(*config_.model),
      contact_(config_.model->joint_count(), config_.real_sensors, config_.hand_excess) {
  if (config_.estimating_model) estimating_.emplace(config_.estimating_model);
  if (config_.real_sensors) sensors_.emplace(joint_count(), config_.seed, config_.torque_sensor.has_value());
  const JointVector zero = joint_constant(joint_count(), 0);
  constexpr double kRounding = 1e-6;  // of a period
  const double periods = config_.plant.command_delay_s / config_.period_s;
  delay_fraction_ = periods - std::floor(periods + kRounding);
  if (delay_fraction_ < kRounding) delay_fraction_ = 0;
  delay_line_.assign(static_cast<std::size_t>(std::ceil(periods - kRounding)), {.valid = false, .tau = zero});
  in_use_.tau = zero;
  q_motor_ = zero;
  last_command_ = tau_desired_ = tau_follow_ = tau_tracked_ = tau_motor_ = q_hold_ = tau_hold_ = zero;
  state_.q = state_.dq = state_.tau_J = state_.tau_J_d = zero;
  interface_.joint_contact = interface_.joint_collision = interface_.dtau_J = interface_.tau_ext_hat = zero;
  reset(q_start);
  recovering_ = 0;  // the first start needs no recovery
}

ArmMode SimulatedArm::mode() const {
  if (user_stop_) return ArmMode::user_stopped;
  if (errors_ != 0) return ArmMode::reflex;
  if (stopped_) return ArmMode::other;
  if (recovering_ > 0 || braking_) return ArmMode::recovering;
  if (guiding_) return ArmMode::guiding;
  return moving_ ? ArmMode::move : ArmMode::idle;
}

void SimulatedArm::reset(const JointVector& q) {
  settings_ = start_settings_;
  load_ = LoadRamp(settings_.load);
  end_motion(MotionEnd::preempted);
  user_stop_ = stopped_ = guiding_ = braking_ = false;
  clear_errors();
  reflex_ = {};
  reflex_reason_ = 0;
  tau_tracked_.setZero();
  contact_.reset();
  q_hold_ = q;
  at_rest_ = ~0u;
  random_.seed(config_.seed);
  normal_.reset();
  if (sensors_) sensors_->reset();
  recovering_ = 2;  // for the measurement that replaces the current one, and the next one
  if (state_.sequence > 0) --state_.sequence;
  publish_configuration();
}

void SimulatedArm::configure_model() {
  model_.set_config(settings_.frames, settings_.tool, load_.now());
  if (estimating_) estimating_->set_config(settings_.frames, settings_.tool, load_.now());
}

void SimulatedArm::publish_configuration() {
  configure_model();
  state_.frames = settings_.frames;
  state_.tool = settings_.tool;
  state_.load = settings_.load;
  ++state_.config_version;
  hold_changed_ = true;  // the end effector may have moved
}

MotionStart SimulatedArm::start_motion(const MotionRequest& request) {
  if (mode() != ArmMode::idle) return MotionStart::not_possible;
  if (!exists(request)) return MotionStart::invalid_argument;
  const MotionStart answer = desired_.start(request);
  if (answer != MotionStart::started) return answer;
  motion_ = request;
  moving_ = true;
  commanded_ = false;
  reflex_ = {};
  reflex_reason_ = 0;
  last_command_.setZero();
  if (counts_own_torque_) {
    torque_rate_.begin(state_.tau_J_d);
  } else {
    torque_rate_.begin();
  }
  controllers_.start();
  measured_limits_.stand_at(state_.q);
  self_collision_.stand_at(model_);
  return MotionStart::started;
}

void SimulatedArm::stop_motion() { end_motion(MotionEnd::preempted); }

// From now on the arm brakes and holds by itself.
void SimulatedArm::end_motion(MotionEnd how) {
  if (moving_) {
    ++motions_ended_;
    motion_end_ = how;
    at_rest_ = 0;
    braking_s_ = 0;
    hold_changed_ = true;
  }
  moving_ = commanded_ = false;
  for (auto& command : delay_line_) command.valid = false;
  in_use_.valid = false;
  received_[0] = received_[1] = 0;
  periods_in_move_ = missing_in_row_ = 0;
}

void SimulatedArm::raise(const ReflexDetail& detail, MotionEnd how) {
  if (errors_ == 0) reflex_ = detail;
  errors_ |= error_bit(detail.error);
  reflex_reason_ = errors_;
  end_motion(how);
}

void SimulatedArm::clear_errors() {
  errors_ = 0;
  interface_.joint_collision.setZero();
  interface_.cartesian_collision.setZero();
}

void SimulatedArm::count_command(bool received) {
  received_[1] = received_[1] << 1 | received_[0] >> 63;
  received_[0] = received_[0] << 1 | (received ? 1u : 0u);
  periods_in_move_ = std::min(periods_in_move_ + 1, 100);
  missing_in_row_ = received ? 0 : missing_in_row_ + 1;
}

void SimulatedArm::push_command(const JointVector& tau_cmd) {
  if (delay_line_.empty()) {
    in_use_.valid = true;
    in_use_.tau = tau_cmd;
    return;
  }
  in_use_ = delay_line_[delay_next_];
  delay_line_[delay_next_].valid = true;
  delay_line_[delay_next_].tau = tau_cmd;
  delay_next_ = (delay_next_ + 1) % delay_line_.size();
  if (delay_fraction_ == 0) return;
  // Each command acts for one period: with a fractional delay the motors get the mean of this and the
  // previous one.
  const Command& newer = delay_line_[delay_next_];
  own_share_ = newer.valid && !in_use_.valid ? delay_fraction_ : 0.0;
  if (!in_use_.valid) in_use_.tau.setZero();
  in_use_.tau = (1 - delay_fraction_) * newer.tau + delay_fraction_ * in_use_.tau;
  in_use_.valid = newer.valid;
}

void SimulatedArm::take_command(const JointVector& tau_cmd) {
  if (mode() == ArmMode::idle) (void)start_motion({});
  if (mode() != ArmMode::move || motion_.generator != MotionGenerator::none) return;
  commanded_ = true;
  count_command(true);
  (void)take_torque(tau_cmd);
}

void SimulatedArm::take_command(const InterfaceCommand& command) {
  if (mode() != ArmMode::move) return;
  const bool generates = motion_.generator != MotionGenerator::none;
  if (!generates && command.torque_finished) {
    end_motion(MotionEnd::finished);
    return;
  }
  commanded_ = true;
  count_command(true);
  if (motion_.controller == ArmController::external) {
    if (generates && command.motion_finished) {
      push_command(last_command_);  // with other torque sources it may be absent
    } else if (!take_torque(command.tau_J_d)) {
      return;
    }
  }
  if (generates) follow(&command);
}

void SimulatedArm::count_replaced(const InterfaceCommand& command) {
  const JointVector& tau = command.tau_J_d;
  const bool generates = motion_.generator != MotionGenerator::none;
  const bool finishes = generates ? command.motion_finished : command.torque_finished;
  if (mode() != ArmMode::move || motion_.controller != ArmController::external || finishes) return;
  if (tau.size() != last_command_.size() || !tau.allFinite()) return;
  if (!torque_rate_.check(tau)) torque_rate_.replace(tau);
}

void SimulatedArm::miss_command() {
  if (mode() != ArmMode::move || !commanded_) return;
  count_command(motion_.asynchronous);
  if (missing_in_row_ >= kLostCommands) {
    raise({.error = ArmError::communication_constraints_violation,
           .value = static_cast<double>(missing_in_row_),
           .limit = kLostCommands});
    return;
  }
  if (motion_.controller == ArmController::external) push_command(last_command_);
  if (motion_.generator != MotionGenerator::none) follow(nullptr);
}

// Returns false for a torque that is not finite or too far from the last one.
bool SimulatedArm::take_torque(const JointVector& tau_cmd) {
  constexpr auto kError = ArmError::controller_torque_discontinuity;
  if (tau_cmd.size() != last_command_.size()) {
    raise({.error = kError}, MotionEnd::input_error);
    return false;
  }
  for (Eigen::Index i = 0; i < tau_cmd.size(); ++i) {
    if (std::isfinite(tau_cmd[i])) continue;
    raise({.error = kError, .index = static_cast<std::int8_t>(i), .value = tau_cmd[i]},
          MotionEnd::input_error);
    return false;
  }
  if (watching_) {
    if (const ReflexDetail jump = torque_rate_.check(tau_cmd)) {
      raise(jump);
      return false;
    }
  }
  torque_rate_.accept(tau_cmd);
  last_command_ = tau_cmd;
  push_command(tau_cmd);
  return true;
}

// One period of desired motion; nullptr: no command arrived.
void SimulatedArm::follow(const InterfaceCommand* command) {
  const MotionStep step = desired_.step(command);
  if (step == MotionStep::moving) return;
  if (step != MotionStep::at_rest) return fail_command(step);
  end_motion(MotionEnd::finished);
  // An arm that followed a desired motion is held where the motion ended, unless it was far from there.
  const JointVector& q_d = desired_.state().q;
  if (motion_.controller != ArmController::external && (q_d - state_.q).cwiseAbs().maxCoeff() < kNear) {
    q_hold_ = q_d;
    at_rest_ = ~0u;
  }
}

void SimulatedArm::fail_command(MotionStep step) {
  if (step == MotionStep::violation) {
    for (const Violation& violation : desired_.violations()) raise(violation);
    return;
  }
  if (step == MotionStep::input_error) {
    raise({.error = no_command(motion_.generator)}, MotionEnd::input_error);
    return;
  }
  // Still moving: braking to rest within one period would exceed the limits.
  if (is_cartesian(motion_.generator)) {
    const Twist& V = desired_.state().V_BE_c;
    const auto& limits = config_.motion_limits.cartesian;
    const double linear = V.linear().norm() / config_.period_s,
                 angular = V.angular().norm() / config_.period_s;
    const bool turns = angular * limits.acceleration > linear * limits.rotation_acceleration;
    raise({.error = ArmError::cartesian_motion_generator_velocity_discontinuity,
           .index = static_cast<std::int8_t>(turns ? 3 : 0),
           .value = turns ? angular : linear,
           .limit = turns ? limits.rotation_acceleration : limits.acceleration},
          MotionEnd::still_moving);
    return;
  }
  const JointVector braking = desired_.state().dq / config_.period_s;
  Eigen::Index worst = 0;
  braking.cwiseAbs().cwiseQuotient(config_.motion_limits.ddq_max).maxCoeff(&worst);
  raise({.error = ArmError::joint_motion_generator_velocity_discontinuity,
         .index = static_cast<std::int8_t>(worst),
         .value = braking[worst],
         .limit = config_.motion_limits.ddq_max[worst]},
        MotionEnd::still_moving);
}

void SimulatedArm::press_guiding(bool pressed) {
  if (pressed && !guiding_) end_motion(MotionEnd::user_stop);
  if (pressed) X_WE_guided_ = model_.X_WE();
  guiding_ = pressed;
  at_rest_ = 0;  // released: it stays at its current position
  braking_s_ = 0;
  hold_changed_ = true;
}

ArmReply SimulatedArm::set_load(const Load& load) {
  const Load& known = settings_.load;
  if (load.mass == known.mass && load.p_FC == known.p_FC && load.inertia_C == known.inertia_C)
    return ArmReply::done;
  if (user_stop_ || errors_ != 0 || stopped_ || guiding_) return ArmReply::takes_no_load;
  settings_.load = load;
  load_.aim(load);
  publish_configuration();
  return ArmReply::done;
}

ArmReply SimulatedArm::apply(const ArmRequest& request) {
  const ArmReply reply = std::visit(Overloaded{[this](const SetLoad& r) { return set_load(r.load); },
                                               [this](const SetFrames& r) {
                                                 if (r.X_FE) settings_.frames.X_FE = *r.X_FE;
                                                 if (r.X_EK) settings_.frames.X_EK = *r.X_EK;
                                                 publish_configuration();
                                                 return ArmReply::done;
                                               },
                                               [this](const SetJointStiffness& r) {
                                                 settings_.joint_stiffness = r.stiffness;
                                                 return ArmReply::done;
                                               },
                                               [this](const SetCartesianStiffness& r) {
                                                 settings_.cartesian_stiffness = r.stiffness;
                                                 return ArmReply::done;
                                               },
                                               [this](const SetCollisionThresholds& r) {
                                                 settings_.thresholds = r;
                                                 return ArmReply::done;
                                               },
                                               [this](const SetGuidingMode& r) {
                                                 settings_.guiding = r;
                                                 return ArmReply::done;
                                               },
                                               [this](const RecoverFromError&) {
                                                 if (errors_ == 0 && !stopped_)
                                                   return ArmReply::nothing_to_recover;
                                                 if (user_stop_) return ArmReply::user_stop_pressed;
                                                 if (errors_ != 0) recovering_ = config_.recovery_periods;
                                                 clear_errors();
                                                 stopped_ = false;
                                                 braking_ = !is_at_rest();
                                                 return ArmReply::done;
                                               },
                                               [this](const StopMotion&) {
                                                 stopped_ = true;
                                                 stop_motion();
                                                 return ArmReply::done;
                                               },
                                               [this](const SetUserStop& r) {
                                                 if (r.pressed && !user_stop_)
                                                   end_motion(MotionEnd::user_stop);
                                                 user_stop_ = r.pressed;
                                                 return ArmReply::done;
                                               },
                                               [](const auto&) { return ArmReply::not_supported; }},
                                    request);
  publish_condition();
  return reply;
}

}  // namespace multipanda
