#include "backends/arm/simulated_arm.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace multipanda {
namespace {

// The arm's own hold: joints as critically damped oscillators of this frequency, made independent of each
// other by the mass matrix, so that light and heavy joints are equally stable at any control period.
constexpr double kHoldFrequency = 60.0;  // [rad/s]
constexpr double kRestVelocity = 0.02;   // a joint slower than this has stopped [rad/s]

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

constexpr double kGuidingDamping = 0.5;  // of every joint while it is guided by hand [N m s/rad]

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};

}  // namespace

SimulatedArm::SimulatedArm(SimulatedArmConfig config, const JointVector& q_start)
    : config_(std::move(config)),
      settings_(start_settings(config_)),
      start_settings_(settings_),
      model_(config_.model) {
  const auto n = joint_count();
  if (static_cast<std::size_t>(q_start.size()) != n) {
    throw std::invalid_argument("the start configuration of arm model '" + config_.model->name() + "' has " +
                                std::to_string(q_start.size()) + " values, the arm has " + std::to_string(n) +
                                " joints");
  }
  for (const Load* load : {&settings_.tool, &settings_.load}) {
    if (const auto why = check_load(*load); !why.empty()) throw std::invalid_argument(why);
  }
  const double periods = config_.plant.command_delay_s / config_.period_s;
  if (!(periods >= 0) || std::abs(periods - std::round(periods)) > 1e-6 || periods > 1000) {
    throw std::invalid_argument("the command delay must be a whole number of control periods of " +
                                std::to_string(config_.period_s) + " s");
  }
  const JointVector zero = joint_constant(n, 0);
  delay_line_.assign(static_cast<std::size_t>(std::lround(periods)), {.valid = false, .tau = zero});
  in_use_.tau = zero;
  last_command_ = tau_wanted_ = tau_tracked_ = tau_motor_ = q_hold_ = tau_hold_ = zero;
  state_.q = state_.dq = state_.tau_J = state_.tau_J_d = zero;
  reset(q_start);
  recovering_ = 0;  // the first start needs no recovery
}

ArmMode SimulatedArm::mode() const {
  if (user_stop_) return ArmMode::user_stopped;
  if (errors_ != 0) return ArmMode::reflex;
  if (stopped_) return ArmMode::other;
  if (recovering_ > 0) return ArmMode::recovering;
  if (guiding_) return ArmMode::guiding;
  return moving_ ? ArmMode::move : ArmMode::idle;
}

void SimulatedArm::reset(const JointVector& q) {
  settings_ = start_settings_;
  user_stop_ = stopped_ = guiding_ = false;
  errors_ = reflex_reason_ = 0;
  reflex_ = {};
  end_motion(MotionEnd::preempted);
  tau_tracked_.setZero();
  q_hold_ = q;
  at_rest_ = ~0u;
  random_.seed(config_.seed);
  normal_.reset();
  recovering_ = 2;  // the measurement that replaces the present one, and the one of the next period
  if (state_.sequence > 0) --state_.sequence;
  publish_configuration();
}

MotionStart SimulatedArm::start_motion(const MotionRequest& request) {
  if (mode() != ArmMode::idle) return MotionStart::not_possible;
  const bool torque_only = request.generator == MotionGenerator::none;
  if (!torque_only || request.controller != ArmController::external || request.asynchronous) {
    return MotionStart::invalid_argument;
  }
  motion_ = request;
  moving_ = true;
  commanded_ = false;
  reflex_ = {};
  reflex_reason_ = 0;
  return MotionStart::started;
}

void SimulatedArm::stop_motion() { end_motion(MotionEnd::preempted); }

void SimulatedArm::press_guiding(bool pressed) {
  if (pressed && !guiding_) end_motion(MotionEnd::user_stop);
  guiding_ = pressed;
  at_rest_ = 0;  // released: hold where it stands then
}

// From now on the arm brakes and holds by itself.
void SimulatedArm::end_motion(MotionEnd how) {
  if (moving_) {
    ++motions_ended_;
    motion_end_ = how;
    at_rest_ = 0;
  }
  moving_ = commanded_ = false;
  for (auto& command : delay_line_) command.valid = false;
  in_use_.valid = false;
  received_[0] = received_[1] = 0;
  periods_in_move_ = missing_in_row_ = 0;
}

void SimulatedArm::raise(const ReflexDetail& detail) {
  if (errors_ == 0) reflex_ = detail;
  errors_ |= error_bit(detail.error);
  reflex_reason_ = errors_;
  end_motion(MotionEnd::reflex);
}

void SimulatedArm::publish_configuration() {
  model_.set_config(settings_.frames, settings_.tool, settings_.load);
  state_.frames = settings_.frames;
  state_.tool = settings_.tool;
  state_.load = settings_.load;
  ++state_.config_version;
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
}

void SimulatedArm::take_command(const JointVector& tau_cmd) {
  if (mode() == ArmMode::idle) (void)start_motion({});
  if (mode() != ArmMode::move) return;
  if (tau_cmd.size() != last_command_.size() || !tau_cmd.allFinite()) {
    raise(ArmError::controller_torque_discontinuity);
    return;
  }
  if (!commanded_) last_command_.setZero();
  commanded_ = true;
  count_command(true);
  last_command_ = tau_cmd;
  push_command(tau_cmd);
}

void SimulatedArm::take_command(const InterfaceCommand& command) {
  if (mode() != ArmMode::move) return;
  if (command.torque_finished) {
    end_motion(MotionEnd::finished);
    return;
  }
  take_command(command.tau_J_d);
}

void SimulatedArm::miss_command() {
  if (mode() != ArmMode::move || !commanded_) return;
  count_command(false);
  if (missing_in_row_ >= kLostCommands) {
    raise({.error = ArmError::communication_constraints_violation,
           .value = static_cast<double>(missing_in_row_),
           .limit = kLostCommands});
    return;
  }
  push_command(last_command_);
}

// tau = M (w^2 (q_hold - q) - 2 w dq) + c; a joint that still moves is only braked, and held where it stops.
const JointVector& SimulatedArm::hold_torque(const JointVector& q, const JointVector& dq) {
  const auto& limit = config_.model->limits().tau_max;
  JointVector acceleration = -2 * kHoldFrequency * dq;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const auto bit = 1u << static_cast<unsigned>(i);
    if ((at_rest_ & bit) == 0) {
      q_hold_[i] = q[i];
      if (std::abs(dq[i]) < kRestVelocity) at_rest_ |= bit;
    }
    acceleration[i] += kHoldFrequency * kHoldFrequency * (q_hold_[i] - q[i]);
  }
  tau_hold_ = model_.c();
  tau_hold_ += model_.M().lazyProduct(acceleration);
  tau_hold_ = tau_hold_.cwiseMax(-limit).cwiseMin(limit);
  return tau_hold_;
}

// Gravity is compensated anyway: what is left for the hand is inertia and a little damping.
const JointVector& SimulatedArm::guided_torque(const JointVector&, const JointVector& dq) {
  tau_hold_ = model_.c() - kGuidingDamping * dq;
  return tau_hold_;
}

const JointVector& SimulatedArm::motor_torque(const JointVector& q, const JointVector& dq, double dt) {
  model_.update(q, dq);
  if (mode() == ArmMode::guiding) {
    tau_wanted_ = guided_torque(q, dq);
  } else {
    tau_wanted_ = moving_ && in_use_.valid ? in_use_.tau : hold_torque(q, dq);
  }
  if (config_.plant.torque_bandwidth_hz > 0) {
    // Exact for a command that stands still during dt.
    const double rate = 2 * std::numbers::pi * config_.plant.torque_bandwidth_hz;
    tau_tracked_ += -std::expm1(-rate * dt) * (tau_wanted_ - tau_tracked_);
  } else {
    tau_tracked_ = tau_wanted_;
  }
  tau_motor_ = tau_tracked_ + model_.g();
  return tau_motor_;
}

void SimulatedArm::measure(const PlantMeasurement& plant) {
  const auto noisy = [this](const JointVector& from, double deviation, JointVector& to) {
    to = from;
    if (deviation <= 0) return;
    for (Eigen::Index i = 0; i < to.size(); ++i) to[i] += deviation * normal_(random_);
  };
  noisy(plant.q, config_.plant.noise_q_rad, state_.q);
  noisy(plant.dq, config_.plant.noise_dq_rad_per_s, state_.dq);
  noisy(plant.tau_link, config_.plant.noise_tau_nm, state_.tau_J);
  state_.tau_J_d = tau_wanted_;
  state_.has_contact_truth = plant.has_contact_truth;
  state_.F_K_W_true = plant.F_K_W_true;

  ++state_.sequence;
  state_.t_robot = RobotTime::from_seconds(static_cast<double>(state_.sequence) * config_.period_s);
  state_.t_host = host_now();
  if (recovering_ > 0) --recovering_;
  state_.mode = mode();
  state_.errors = errors_;
  if (moving_ && periods_in_move_ > 0) {
    constexpr std::uint64_t kUpper = (std::uint64_t{1} << 36) - 1;  // 100 - 64 bits
    const int count = std::popcount(received_[0]) + std::popcount(received_[1] & kUpper);
    state_.command_success_rate = static_cast<double>(count) / periods_in_move_;
  } else {
    state_.command_success_rate = 0;
  }
  publish_interface();
}

void SimulatedArm::publish_interface() {
  interface_.q_d = state_.q;
  interface_.dq_d = state_.dq;
  interface_.ddq_d = joint_constant(joint_count(), 0);
  interface_.theta = state_.q;
  interface_.dtheta = state_.dq;
  interface_.mode = state_.mode;
  interface_.errors = errors_;
  interface_.reflex_reason = reflex_reason_;
  interface_.command_success_rate = state_.command_success_rate;
  const bool moves = state_.mode == ArmMode::move;
  interface_.controller = moves ? motion_.controller : ArmController::other;
  interface_.generator = moves ? motion_.generator : MotionGenerator::idle;
}

ArmReply SimulatedArm::apply(const ArmRequest& request) {
  const ArmReply reply = std::visit(Overloaded{[this](const SetLoad& r) {
                                                 settings_.load = r.load;
                                                 publish_configuration();
                                                 return ArmReply::done;
                                               },
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
                                                 errors_ = 0;
                                                 stopped_ = false;
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
  state_.mode = mode();
  state_.errors = errors_;
  return reply;
}

}  // namespace multipanda
