#include "fci/client/arm_driver.hpp"

#include <algorithm>
#include <cmath>
#include <poll.h>
#include <stdexcept>
#include <sys/eventfd.h>
#include <unistd.h>

#include "core/types/time.hpp"
#include "fci/client/arm_mode.hpp"

namespace multipanda::fci {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;

MotionRequest request_of(ArmMotion motion) {
  using enum ArmMotion;
  const bool joints = motion == joint_position || motion == joint_velocity;
  return {.controller = motion == torque ? ArmController::external
                        : joints         ? ArmController::joint_impedance
                                         : ArmController::cartesian_impedance,
          .generator = motion == joint_position       ? MotionGenerator::joint_position
                       : motion == joint_velocity     ? MotionGenerator::joint_velocity
                       : motion == cartesian_pose     ? MotionGenerator::cartesian_pose
                       : motion == cartesian_velocity ? MotionGenerator::cartesian_velocity
                                                      : MotionGenerator::none,
          .asynchronous = false,
          .dq_max = {}};
}

}  // namespace

ArmDriver::ArmDriver(FciArmConfig config, const FciOptions& options)
    : config_(std::move(config)),
      options_(options),
      settings_(config_),
      link_({.name = config_.name,
             .address = config_.address,
             .port = config_.port,
             .version = config_.version,
             .state_timeout_s = options.state_timeout_s,
             .loop_reads_states = true}),
      end_effector_(config_.end_effector ? config_.end_effector() : nullptr),
      requested_motion_(options.begin_torque ? ArmMotion::torque : ArmMotion::none),
      handled_motion_(requested_motion_.load()),
      wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      packet_(config_.model->X_WB(), config_.hand_declared.value_or(config_.hand)),
      limiter_({.tau_max = config_.model->limits().tau_max,
                .tau_rate_max = config_.model->limits().tau_rate_max.cwiseMin(kTorqueRateMax),
                .period_s = kArmPeriod,
                .low_pass_hz = config_.limit_rate ? config_.low_pass_hz : 0.0}),
      posture_(config_.model, config_.frames, config_.tool, config_.load) {
  if (wake_ < 0) throw std::runtime_error("cannot open an eventfd for arm '" + config_.name + "'");
  thread_ = std::thread([this] { run(); });
}

ArmDriver::~ArmDriver() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  (void)::eventfd_write(wake_, 1);
  thread_.join();
  ::close(wake_);
}

Capabilities ArmDriver::capabilities() const {
  return {.simulated = false,
          .lockstep = options_.lockstep,
          .compensates_gravity = true,
          .compensates_friction = true,
          .has_external_torque = true,
          .has_contact_truth = false,
          .has_gripper = end_effector_ != nullptr && !end_effector_->is_vacuum(),
          .has_vacuum = end_effector_ != nullptr && end_effector_->is_vacuum(),
          .every_command_arrives = options_.lockstep,
          .own_clock = !options_.lockstep,
          .torque_low_pass_hz = config_.limit_rate ? 0.0 : config_.low_pass_hz,
          .torque_rate_max = kTorqueRateMax};
}

ArmIdentity ArmDriver::identity() const {
  const std::lock_guard lock(mutex_);
  return identity_;
}

// --- commander ---

std::future<RequestAnswer> ArmDriver::post(Task task, bool next) {
  auto future = task.promise.get_future();
  {
    const std::lock_guard lock(mutex_);
    tasks_.insert(next ? tasks_.begin() : tasks_.end(), std::move(task));
  }
  (void)::eventfd_write(wake_, 1);
  return future;
}

void ArmDriver::run() {
  while (true) {
    std::array<pollfd, 2> watched{{{.fd = wake_, .events = POLLIN, .revents = 0},
                                   {.fd = link_.tcp_file(), .events = POLLIN, .revents = 0}}};
    constexpr int kSliceMs = 100;  // interval between checks for gaps
    (void)link_.gaps().look();
    (void)::poll(watched.data(), watched.size(), kSliceMs);
    (void)link_.gaps().look();
    eventfd_t count = 0;
    (void)::eventfd_read(wake_, &count);
    watch();
    if (const char* why = stop_requested_.exchange(nullptr, std::memory_order_acq_rel)) {
      notify(std::string(why) + ", and the motion was stopped: run " + ctl_command("recover"));
      (void)guarded([this] { return stop(); });
    }
    if (const double share = low_success_.exchange(1, std::memory_order_acq_rel); share < 1) {
      notify("it received only " + std::to_string(std::lround(100 * share)) +
             " % of the last 100 commands, and stops after 20 lost ones in a row: `multipanda doctor` says "
             "whether this computer or the network is late");
    }
    change_motion();
    while (do_next_task()) {
    }
    const std::lock_guard lock(mutex_);
    if (ending_ && tasks_.empty()) break;
  }
  link_.close();
}

bool ArmDriver::do_next_task() {
  Task task;
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.empty()) return false;
    task = std::move(tasks_.front());
    tasks_.pop_front();
    if (ending_) task.work = [] { return RequestAnswer{false, "the backend is being closed"}; };
  }
  const HostTime now = host_now();
  if (task.ages && (seconds(now - task.posted) >= options_.request_patience_s ||
                    is_past(task.begin_by, now) || task.posted < link_.gaps().look())) {
    task.work = [this] { return RequestAnswer{false, config_.name + ": " + kRequestTooOld}; };
  }
  task.promise.set_value(guarded(task.work));
  return true;
}

RequestAnswer ArmDriver::guarded(const Work& work) {
  try {
    return work();
  } catch (const ConnectionError& error) {
    if (error.is_fatal()) lost(error.what());
    return {false, error.what()};
  } catch (const std::exception& error) {
    return {false, config_.name + ": " + error.what()};
  }
}

// Between tasks: handles the end of a motion or of the connection.
void ArmDriver::watch() {
  if (!link_.is_connected()) return;
  try {
    const auto end = link_.poll_motion();
    if (!end || phase() != Phase::running) return;
    enter(Phase::stopped);
    if (!end->text.empty()) {
      // The state with the reason may arrive after the reply.
      constexpr double kSoon = 0.05;  // [s]
      (void)link_.wait_for_state([](const RobotState& s) { return !is_mode(s, RobotMode::move); }, kSoon);
      notify(end->text + " " + error_list(link_.look()) + "and the arm holds itself: run " +
             ctl_command("recover"));
    }
  } catch (const ConnectionError& error) {
    lost(error.what());
  }
}

void ArmDriver::lost(const std::string& why) {
  const bool was_in_use = takes_part();
  link_.close();
  enter(Phase::offline);
  if (was_in_use) notify(why + ": " + ctl_command("reconnect"));
}

void ArmDriver::notify(const std::string& text) const {
  const bool named = text.find("arm " + config_.name) != std::string::npos;
  if (options_.report) options_.report(named ? text : "arm " + config_.name + ": " + text);
}

void ArmDriver::refuse(const std::string& text) const {
  throw ConnectionError(ConnectionError::Kind::refused, "arm " + config_.name + ": " + text);
}

std::string ArmDriver::ctl_command(const char* word) const {
  return std::string("`multipanda ctl ") + word + " " + config_.name + "`";
}

std::future<RequestAnswer> ArmDriver::prepare() {
  return post([this] {
    left_ = false;
    settings_ = Settings(config_);
    load_is_unknown_ = false;
    connect_and_configure();
    return RequestAnswer{true, {}};
  });
}

std::future<RequestAnswer> ArmDriver::begin() {
  return post([this] {
    if (configured_) start_requested_motion(false);  // an arm found in a reflex starts once it is recovered
    return RequestAnswer{true, {}};
  });
}

std::future<RequestAnswer> ArmDriver::leave(bool finished) {
  return post([this, finished] {
    left_ = true;
    if (link_.is_connected() && link_.has_motion()) {
      constexpr double kEnd = 0.3;  // [s] for the reply to a motion that was finished in the loop
      try {
        (void)link_.wait_for_end(finished ? kEnd : 0);
      } catch (const ConnectionError& error) {
        if (error.kind() != ConnectionError::Kind::timeout) throw;
        link_.stop();
      }
    }
    enter(Phase::offline);
    link_.close();
    return RequestAnswer{true, {}};
  });
}

std::future<RequestAnswer> ArmDriver::request(GripperRequest request) {
  if (end_effector_ == nullptr) {
    return refuse_request("arm " + config_.name + " has no gripper in this run: add one to the scene");
  }
  if (!end_effector_connected_.load(std::memory_order_acquire)) {
    return refuse_request("the gripper of arm " + config_.name +
                          " is not connected: " + ctl_command("reconnect"));
  }
  return end_effector_->request(request);
}

std::future<RequestAnswer> ArmDriver::request(ArmRequest request) {
  const HostTime now = host_now();
  const auto post_request = [&](Work work) {
    return post({std::move(work), {}, now, true, request.begin_by});
  };
  if (std::holds_alternative<RecoverFromError>(request))
    return post_request([this, now] { return recover(now); });
  if (std::holds_alternative<Reconnect>(request)) return post_request([this, now] { return reconnect(now); });
  if (std::holds_alternative<StopMotion>(request)) {  // never too late, and before all waiting requests
    stopped_ns_.store(now.ns, std::memory_order_release);
    return post({[this] { return stop(); }, {}, now}, true);
  }
  if (std::holds_alternative<SetUserStop>(request)) {
    return refuse_request("a real arm does not support this request: it is for simulated arms");
  }
  return post_request([this, request] {
    if (!takes_part()) refuse("it is not connected: " + ctl_command("reconnect"));
    apply_beside_motion(request);
    return RequestAnswer{true, {}};
  });
}

// --- motion and recovery ---

void ArmDriver::start_requested_motion(bool loop_runs) {
  const ArmMotion motion = handled_motion_ = requested_motion_.load(std::memory_order_acquire);
  motion_.store(motion, std::memory_order_release);
  running_ns_.store(kUnanswered, std::memory_order_release);
  enter(Phase::starting);
  try {
    if (!configured_ && !(configured_ = configure())) refuse(in_reflex(link_.look()));
    if (motion == ArmMotion::none) {
      enter(Phase::stopped);
      return;
    }
    if (load_is_unknown_) refuse(unknown_load() + ", then run " + ctl_command("recover"));
    link_.start_motion(request_of(motion));
    link_.wait_until_running();
  } catch (const ConnectionError& error) {
    if (!error.is_fatal()) enter(Phase::stopped);
    throw;
  }
  std::int64_t unanswered = kUnanswered;  // by the loop, which may be faster
  running_ns_.compare_exchange_strong(unanswered, loop_runs ? host_now().ns : 0);
  enter(Phase::running);
}

// The loop requests a different motion. If the arm is not ready, its recovery starts the motion.
void ArmDriver::change_motion() {
  if (handled_motion_ == requested_motion_.load(std::memory_order_acquire)) return;
  handled_motion_ = requested_motion_.load(std::memory_order_acquire);
  if (!takes_part()) return;
  watch();
  const auto answer = guarded([this] {
    if (link_.is_connected() && link_.has_motion()) link_.stop();
    const RobotState& state = link_.look();
    if (handled_motion_ != ArmMotion::none && !is_mode(state, RobotMode::idle) &&
        !is_mode(state, RobotMode::move)) {
      enter(Phase::stopped);
      return RequestAnswer{false, config_.name + ": " + refusal_in_mode(config_.name, state)};
    }
    start_requested_motion();
    return RequestAnswer{true, {}};
  });
  if (!answer.success) notify(answer.reason);
}

// A requested motion, unless it was stopped or the program stalled since; also while it starts, because an
// arm may wait for its first command.
void ArmDriver::start_motion_of(HostTime asked) {
  const auto check = [&] {
    const bool stopped = asked.ns < stopped_ns_.load(std::memory_order_acquire);
    if (!stopped && asked >= link_.gaps().look()) return;  // also since the last wait
    if (link_.has_motion()) link_.stop();
    enter(Phase::stopped);
    refuse((stopped ? std::string("its motion has been stopped since") : kStalled) + ": run " +
           ctl_command("recover"));
  };
  check();
  start_requested_motion();
  check();
}

RequestAnswer ArmDriver::recover(HostTime asked) {
  if (!takes_part()) refuse("it is not connected: " + ctl_command("reconnect"));
  watch();
  if (!takes_part()) refuse("its connection has just been lost: " + ctl_command("reconnect"));
  const RobotState& state = link_.look();
  const bool rests = configured_ && is_mode(state, RobotMode::idle) && error_list(state).empty() &&
                     requested_motion_.load(std::memory_order_acquire) == ArmMotion::none;
  if (rests || (is_mode(state, RobotMode::move) && phase() == Phase::running)) {
    refuse("it has no error and was not stopped: there is nothing to recover from");
  }
  if (is_mode(state, RobotMode::user_stopped) || is_mode(state, RobotMode::guiding) ||
      is_mode(state, RobotMode::other)) {
    refuse(refusal_in_mode(config_.name, state));
  }
  if (is_mode(state, RobotMode::reflex) || !error_list(state).empty()) {
    enter(Phase::starting);
    try {
      link_.recover();
    } catch (const ConnectionError& error) {
      if (!error.is_fatal()) enter(Phase::stopped);
      throw;
    }
  }
  start_motion_of(asked);
  return {true, {}};
}

RequestAnswer ArmDriver::reconnect(HostTime asked) {
  if (left_) refuse("its run has ended, and nothing would answer it: start the run again");
  watch();
  const auto before = link_.statistics().received;
  if (takes_part() &&
      link_.wait_for_state([&](const RobotState&) { return link_.statistics().received != before; }, 0.1)) {
    refuse("it is connected: there is nothing to reconnect");
  }
  link_.close();
  connect_and_configure();
  if (!configured_) refuse(in_reflex(link_.look()));
  start_motion_of(asked);
  return {true, {}};
}

RequestAnswer ArmDriver::stop() {
  if (!takes_part()) refuse("it is not connected: " + ctl_command("reconnect"));
  link_.stop();
  enter(Phase::stopped);
  return {true, {}};
}

// --- loop ---

void ArmDriver::receive() noexcept { unread_ = link_.receive() || (unread_ && !link_.is_stale()); }

ArmMode ArmDriver::mode(HostTime now) const noexcept {
  const Phase phase = this->phase();
  if (phase == Phase::offline || newest().message_id == 0) return ArmMode::disconnected;
  if (!options_.lockstep && seconds(now - link_.received_at()) > options_.lost_after_s) {
    return ArmMode::disconnected;
  }
  return mode_of(newest(), phase, motion(), requested_motion_.load(std::memory_order_acquire));
}

void ArmDriver::fill(HostTime now, ArmState& state) noexcept {
  state.mode = mode(now);
  if (state.mode != ArmMode::move) commanded_ = refused_ = false;
  packet_.fill(newest(), commanded_, state);
  state.report.present = state.mode != ArmMode::disconnected;
  success_.take(state.sequence, state.mode == ArmMode::move, state.command_success_rate, now.seconds());
  if (success_.take_low()) {
    low_success_.store(state.command_success_rate, std::memory_order_release);
    (void)::eventfd_write(wake_, 1);
  }
  state.t_host = link_.received_at();
  if (end_effector_ != nullptr && end_effector_connected_.load(std::memory_order_acquire)) {
    state.gripper = end_effector_->state();
  } else {
    state.gripper = {};
  }
}

void ArmDriver::request_motion(ArmMotion motion) noexcept {
  requested_motion_.store(motion, std::memory_order_release);
  (void)::eventfd_write(wake_, 1);
}

void ArmDriver::command(RobotCommand& command) noexcept {
  if (motion() == ArmMotion::torque || mode(link_.received_at()) != ArmMode::move) return;
  command.motion_generation_finished = command.torque_command_finished = false;
  (void)link_.send(command);
}

void ArmDriver::command(const JointVector& tau_cmd) noexcept {
  if (motion() != ArmMotion::torque || refused_ || mode(link_.received_at()) != ArmMode::move) return;
  if (tau_cmd.size() != 7 || !tau_cmd.allFinite())
    return refuse_motion("an invalid torque command was rejected");
  // An arm waits without limit for the first torque: this program may have stalled since, even in this cycle.
  const std::int64_t running = running_ns_.load(std::memory_order_acquire);
  if (!commanded_ && !options_.lockstep && running > 0 &&
      host_now().ns - running > std::chrono::nanoseconds(GapWatch::kLongest).count())
    return refuse_motion("this program stalled before the motion's first torque");
  send_torque(config_.limit_rate || !commanded_ ? limited(tau_cmd) : tau_cmd);
  if (commanded_ && running != 0) running_ns_.store(0, std::memory_order_release);
}

void ArmDriver::refuse_motion(const char* why) noexcept {
  refused_ = true;
  stop_requested_.store(why, std::memory_order_release);
  (void)::eventfd_write(wake_, 1);
}

void ArmDriver::hold(bool last) noexcept {
  if (motion() != ArmMotion::torque || mode(link_.received_at()) != ArmMode::move) return;
  ++held_packets_;
  const RobotState& state = newest();
  const JointVector& tau = limited(
      posture_.torque(Eigen::Map<const Vector7>(state.q.data()), Eigen::Map<const Vector7>(state.dq.data())));
  if (last) ArmConnection::mark_finished(link_.dialect(), false, command_);
  send_torque(tau);
}

// Relative to the torque in use.
const JointVector& ArmDriver::limited(const JointVector& tau) noexcept {
  const Eigen::Map<const Vector7> shown(newest().tau_J_d.data());
  if (commanded_) {
    limiter_.observe(shown);
  } else {
    limiter_.begin(shown);
  }
  TorqueLimiter::Cuts cuts;
  return limiter_.limit(tau, kArmPeriod, cuts);
}

void ArmDriver::send_torque(const JointVector& tau) noexcept {
  std::copy(tau.begin(), tau.end(), command_.tau_J_d.begin());
  const bool sent = link_.send(command_);
  command_.motion_generation_finished = command_.torque_command_finished = false;
  if (!sent) return;
  limiter_.restart(tau);
  commanded_ = true;
}

}  // namespace multipanda::fci
