#include "runtime/embedded/interface_backend.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "arm_interface/arm_settings.hpp"

namespace multipanda {
namespace {

void copy_joints(const std::array<double, kMaxJoints>& from, std::size_t n, JointVector& to) {
  to.resize(static_cast<Eigen::Index>(n));
  std::copy_n(from.begin(), n, to.data());
}

std::string who_holds(const std::string& arm) {
  return "arm '" + arm +
         "': its hardware does not report whether it compensates gravity; set the parameter 'arms." + arm +
         ".gravity_compensation' to 'robot' if the robot does, or to 'controller' if torques must include it";
}

std::string no_such_request(const std::string& arm) {
  return "the hardware of arm '" + arm +
         "' does not offer this request to its controllers: send it to the hardware's own node";
}

std::string joint_name(const InterfaceBackend::Arm& arm, std::size_t i) {
  return arm.host.joints.empty() ? arm.host.name + "_joint" + std::to_string(i + 1) : arm.host.joints[i];
}

}  // namespace

InterfaceBackend::PlainArm::PlainArm(Arm a) : arm(std::move(a)), terms(arm.model), load(arm.config.load) {
  requested.config = configuration.config = arm.config;
  tau_cmd = tau_then = joint_constant(joints(), 0);
  terms.set_config(arm.config.frames, arm.config.tool, arm.config.load);
  terms.update(arm.model->q_home(), tau_cmd);
}

bool InterfaceBackend::PlainArm::is_finite() const {
  bool finite = true;
  for (std::size_t i = 0; i < joints(); ++i) {
    finite = finite && std::isfinite(signals.position[i]) && std::isfinite(signals.velocity[i]) &&
             (!signals.has_effort || std::isfinite(signals.effort[i]));
  }
  return finite;
}

// Time since the arm's numbers last changed.
void InterfaceBackend::PlainArm::watch_numbers(double dt) {
  bool same = true;
  const auto compare = [&](const std::array<double, kMaxJoints>& now, std::size_t first) {
    for (std::size_t i = 0; i < joints(); ++i) {
      double& before = numbers[first + i];
      same = same && std::memcmp(&before, &now[i], sizeof(double)) == 0;
      before = now[i];
    }
  };
  compare(signals.position, 0);
  compare(signals.velocity, kMaxJoints);
  if (signals.has_effort) compare(signals.effort, 2 * kMaxJoints);
  if (same) {
    still_s += dt;
    frozen = frozen || (still_s > arm.safety.max_silence_s && contradicts());
  } else {
    still_s = 0;
    frozen = false;
    tau_then = tau_cmd;
  }
}

// Whether constant numbers are implausible for an arm.
bool InterfaceBackend::PlainArm::contradicts() const {
  constexpr double kMoves = 0.05, kSlides = 0.01;  // [rad/s], [m/s]: within 20 ms, any encoder sees it
  constexpr double kTorqueShare = 0.05;            // of the limit: friction may carry less
  for (std::size_t i = 0; i < joints(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    if (std::abs(signals.velocity[i]) > (arm.model->is_prismatic(i) ? kSlides : kMoves)) return true;
    if (std::abs(tau_cmd[k] - tau_then[k]) > kTorqueShare * arm.safety.joints.tau_max[k]) return true;
  }
  return false;
}

InterfaceBackend::InterfaceBackend(std::vector<Arm> arms, double period_s) : period_s_(period_s) {
  if (!(period_s > 0) || period_s > 0.1) {
    throw std::invalid_argument("a control period of 0 to 0.1 s is expected (update_rate of at least 10 Hz)");
  }
  for (auto& arm : arms) {
    if (!arm.host.joints.empty() && arm.host.joints.size() != arm.model->joint_count()) {
      throw std::invalid_argument("arm '" + arm.host.name + "': the model has " +
                                  std::to_string(arm.model->joint_count()) + " joints, 'joints' has " +
                                  std::to_string(arm.host.joints.size()));
    }
    if (!arm.host.has_robot_state && arm.host.gravity == HostedArm::Gravity::unspecified) {
      throw std::invalid_argument(who_holds(arm.host.name));
    }
    arms_.push_back(std::make_unique<PlainArm>(std::move(arm)));
  }
}

InterfaceBackend::~InterfaceBackend() = default;

// Prevents forces in place of torques, or meters in place of radians. Hardware without a model does not
// report its kinds of joints.
std::string InterfaceBackend::unlike_joints(const PlainArm& arm) {
  if (arm.signals.shared->model == nullptr) return {};
  const ArmModel &theirs = arm.signals.shared->model->model(), &ours = *arm.arm.model;
  for (std::size_t i = 0; i < std::min(theirs.joint_count(), ours.joint_count()); ++i) {
    if (theirs.is_prismatic(i) == ours.is_prismatic(i)) continue;
    const auto kind = [i](const ArmModel& model) { return model.is_prismatic(i) ? "prismatic" : "revolute"; };
    return "joint '" + joint_name(arm.arm, i) + "' is " + kind(theirs) + " in the hardware's arm and " +
           kind(ours) + " in the model; give both the same model";
  }
  return {};
}

std::string InterfaceBackend::check() const {
  for (const auto& arm : arms_) {
    const std::string who = "arm '" + arm->arm.host.name + "': ";
    if (arm->signals.shared == nullptr && arm->arm.host.gravity == HostedArm::Gravity::unspecified) {
      return who_holds(arm->arm.host.name);
    }
    if (arm->signals.shared != nullptr) {
      const auto joints = static_cast<std::size_t>(arm->signals.shared->state.q.size());
      if (joints != arm->joints())
        return who + "the hardware's arm has " + std::to_string(joints) + " joints, the model has " +
               std::to_string(arm->joints());
      if (std::string why = unlike_joints(*arm); !why.empty()) return who + why;
      continue;
    }
    for (std::size_t i = 0; i < arm->joints(); ++i) {
      if (!std::isfinite(arm->signals.position[i]) || !std::isfinite(arm->signals.velocity[i])) {
        return who + "joint '" + joint_name(arm->arm, i) +
               "' has no finite position and velocity yet: check that its hardware is active";
      }
    }
  }
  return {};
}

void InterfaceBackend::begin() {
  for (auto& arm : arms_) {
    arm->recovering = arm->activations > 0;
    ++arm->activations;
    arm->tau_cmd.setZero();
    arm->silent_s = arm->still_s = 0;
    arm->frozen = false;
    arm->numbers.fill(std::numeric_limits<double>::quiet_NaN());
    const SharedArmState* shared = arm->signals.shared;
    arm->last_sequence = 0;
    if (shared != nullptr) arm->last_robot_time = shared->state.t_robot;
    arm->requests_to.store(shared, std::memory_order_release);
  }
}

ArmSet InterfaceBackend::advance(double period_s) {
  dt_ = std::isfinite(period_s) && period_s > 0 ? period_s : period_s_;
  if (dt_ > 1.5 * period_s_) {
    const auto missed = static_cast<std::uint64_t>(std::lround(dt_ / period_s_)) - 1;
    overruns_.store(overruns_.load(std::memory_order_relaxed) + missed, std::memory_order_relaxed);
  }
  // In lock-step the hardware's clock counts: it advances by whole periods, independent of the wall clock.
  const auto stepped = std::find_if(arms_.begin(), arms_.end(), [](const auto& arm) {
    return arm->signals.shared != nullptr && arm->signals.shared->capabilities.lockstep;
  });
  if (stepped != arms_.end()) {
    PlainArm& arm = **stepped;
    const RobotTime t = arm.signals.shared->state.t_robot;
    const double passed = seconds(t - arm.last_robot_time);
    arm.last_robot_time = t;
    const bool first = arm.last_sequence == 0;
    constexpr double kJump = 1.0;  // [s]; a larger step means another world's clock
    if (!first && passed >= 0 && passed < kJump) dt_ = passed;
  }
  now_ = now_ + std::chrono::nanoseconds(static_cast<std::int64_t>(std::llround(dt_ * 1e9)));
  ArmSet due;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    PlainArm& arm = *arms_[i];
    const SharedArmState* shared = arm.signals.shared;
    if (shared == nullptr) arm.watch_numbers(dt_);
    if (arm.frozen) arm.silent_s = std::max(arm.silent_s, arm.still_s);
    const bool fresh = shared == nullptr ? arm.is_finite() && !arm.frozen
                                         : shared->state.sequence != arm.last_sequence &&
                                               shared->state.mode != ArmMode::disconnected;
    if (fresh) due |= ArmSet::of(i);
  }
  return due;
}

Capabilities InterfaceBackend::capabilities(ArmIndex arm) const {
  Capabilities can;
  if (const SharedArmState* shared = arms_[arm]->requests_to.load(std::memory_order_acquire)) {
    can = shared->capabilities;
    can.torque_low_pass_hz = 0;  // applied by the hardware, for any controller
  } else {
    can.own_clock = true;  // unknown yet, or not reported by its hardware
  }
  can.compensates_gravity = true;  // by the arm or by write()
  can.has_external_torque = arms_[arm]->arm.host.forces_by_robot;
  return can;
}

void InterfaceBackend::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    PlainArm& arm = *arms_[i];
    const SharedArmState* shared = arm.signals.shared;
    if (!due.contains(i)) {
      if (arm.recovering) states[i].mode = ArmMode::recovering;  // the known mode is outdated
      const bool lost = shared != nullptr ? shared->state.mode == ArmMode::disconnected : arm.is_lost();
      if (lost) states[i].mode = ArmMode::disconnected;
      continue;
    }
    if (shared != nullptr) {
      states[i] = shared->state;
      states[i].config_version += arm.activations << 16;
      arm.last_sequence = shared->state.sequence;
    } else {
      read_plain(arm, states[i]);
    }
    if (arm.recovering) states[i].mode = ArmMode::recovering;
    if (arm.adds_gravity() || !arm.signals.has_effort) arm.terms.update(states[i].q, states[i].dq);
    arm.recovering = false;
  }
}

void InterfaceBackend::read_plain(PlainArm& arm, ArmState& state) const {
  if (arm.updates.take()) {
    arm.configuration = arm.updates.value();
    arm.load.aim(arm.configuration.config.load);
  }
  const ArmConfig& config = arm.configuration.config;
  if (arm.load.advance(dt_)) arm.terms.set_config(config.frames, config.tool, arm.load.now());
  const std::size_t n = arm.joints();
  state.sequence = ++arm.sequence;
  state.t_robot = {now_.ns};
  state.t_host = host_now();
  copy_joints(arm.signals.position, n, state.q);
  copy_joints(arm.signals.velocity, n, state.dq);
  if (arm.signals.has_effort) {
    copy_joints(arm.signals.effort, n, state.tau_J);
  } else {
    arm.terms.update(state.q, state.dq);
    state.tau_J = arm.tau_cmd + arm.terms.g();
  }
  state.tau_J_d = arm.tau_cmd;
  state.config_version = (arm.activations << 16) + arm.configuration.version;
  state.frames = config.frames;
  state.tool = config.tool;
  state.load = config.load;
  state.mode = ArmMode::move;
  state.errors = 0;
}

void InterfaceBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    PlainArm& arm = *arms_[i];
    if (due.contains(i)) {
      arm.silent_s = 0;
      const bool usable = commands[i].usable && commands[i].tau_cmd.size() == arm.tau_cmd.size() &&
                          commands[i].tau_cmd.allFinite();
      if (usable) {
        arm.tau_cmd = commands[i].tau_cmd;
      } else {
        arm.tau_cmd.setZero();
      }
      send(arm, usable);
    } else {
      arm.silent_s += dt_;
      if (!arm.is_lost()) continue;
      arm.tau_cmd.setZero();
      send(arm, false);
    }
  }
}

void InterfaceBackend::send(PlainArm& arm, bool with_torque) {
  const bool gravity = arm.adds_gravity();
  const JointVector& tau_max = arm.arm.safety.joints.tau_max;
  const JointVector& g = arm.terms.g();
  for (std::size_t i = 0; i < arm.joints(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double tau = (with_torque ? arm.tau_cmd[k] : 0.0) + (gravity ? g[k] : 0.0);
    arm.signals.effort_command[i] = std::clamp(tau, -tau_max[k], tau_max[k]);
  }
}

void InterfaceBackend::leave() {
  for (auto& arm : arms_) {
    if (arm->signals.shared == nullptr && arm->is_finite()) {
      JointVector q, dq;
      copy_joints(arm->signals.position, arm->joints(), q);
      copy_joints(arm->signals.velocity, arm->joints(), dq);
      arm->terms.update(q, dq);
    }
    arm->tau_cmd.setZero();
    send(*arm, false);
    arm->requests_to.store(nullptr, std::memory_order_release);
  }
}

void InterfaceBackend::share_stopped(ArmSet stopped) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    const SharedArmState* shared = arms_[i]->signals.shared;
    if (shared != nullptr && stopped.contains(i)) shared->stopped = SharedArmState::kStopped;
  }
}

const SharedArmState* InterfaceBackend::shared_backend(ArmIndex arm) const {
  const SharedArmState* shared = arms_[arm]->requests_to.load(std::memory_order_acquire);
  return shared != nullptr && shared->backend != nullptr ? shared : nullptr;
}

std::future<RequestAnswer> InterfaceBackend::request(ArmIndex arm, ArmRequest request) {
  if (arm >= arms_.size()) return refuse_request(no_such_arm(arm, arms_.size()));
  if (const SharedArmState* shared = shared_backend(arm))
    return shared->backend->request(shared->arm, std::move(request));
  PlainArm& target = *arms_[arm];
  if (auto why = check_request(request, *target.arm.model); !why.empty())
    return refuse_request(std::move(why));
  return answer_now(configure(target, request));
}

std::future<RequestAnswer> InterfaceBackend::request(ArmIndex arm, GripperRequest request) {
  if (arm >= arms_.size()) return refuse_request(no_such_arm(arm, arms_.size()));
  if (const SharedArmState* shared = shared_backend(arm))
    return shared->backend->request(shared->arm, std::move(request));
  return refuse_request(no_such_request(arms_[arm]->arm.host.name));
}

// The arms of one simulated world share its backend, so the first simulated arm gives access to it.
std::future<RequestAnswer> InterfaceBackend::request(WorldRequest request) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    const SharedArmState* shared = shared_backend(i);
    if (shared != nullptr && shared->capabilities.simulated)
      return shared->backend->request(std::move(request));
  }
  return Backend::request(std::move(request));
}

// If a robot does not support such requests, the settings are stored here, for the controllers.
RequestAnswer InterfaceBackend::configure(PlainArm& arm, const ArmRequest& request) {
  const std::lock_guard lock(mutex_);
  if (const auto* load = std::get_if<SetLoad>(&request)) {
    arm.requested.config.load = load->load;
  } else if (const auto* frames = std::get_if<SetFrames>(&request)) {
    if (frames->X_FE) arm.requested.config.frames.X_FE = *frames->X_FE;
    if (frames->X_EK) arm.requested.config.frames.X_EK = *frames->X_EK;
  } else {
    return {false, no_such_request(arm.arm.host.name)};
  }
  ++arm.requested.version;
  arm.updates.write(arm.requested);
  return {true, {}};
}

}  // namespace multipanda
