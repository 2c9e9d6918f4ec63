#include "fci/client/arm_driver.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <poll.h>
#include <stdexcept>
#include <sys/eventfd.h>
#include <unistd.h>

#include "fci/client/model_check.hpp"

namespace multipanda::fci {
namespace {

constexpr double kPeriod = 0.001;  // of the arm [s]

bool is_mode(const RobotState& state, RobotMode mode) {
  return state.robot_mode == static_cast<std::uint8_t>(mode);
}

// Torques are taken: of our kind of motion, by either way of asking for it.
bool takes_torques(const RobotState& state) {
  const auto generator = static_cast<MotionGeneratorMode>(state.motion_generator_mode);
  return is_mode(state, RobotMode::move) &&
         state.controller_mode == static_cast<std::uint8_t>(ControllerMode::external) &&
         (generator == MotionGeneratorMode::none || generator == MotionGeneratorMode::joint_velocity);
}

bool is_close(const Pose& a, const Pose& b) {
  constexpr double kSame = 1e-5;  // single precision of some metres is 1e-7
  return (a.rotation - b.rotation).cwiseAbs().maxCoeff() < kSame &&
         (a.position - b.position).cwiseAbs().maxCoeff() < kSame;
}

bool is_close(const Load& a, const Load& b) {
  constexpr double kSame = 1e-4;
  return std::abs(a.mass - b.mass) < kSame && (a.p_FC - b.p_FC).cwiseAbs().maxCoeff() < kSame &&
         (a.inertia_C - b.inertia_C).cwiseAbs().maxCoeff() < kSame;
}

template <std::size_t N, class Vector>
std::array<double, N> to_array(const Vector& values) {
  std::array<double, N> result{};
  for (std::size_t i = 0; i < N; ++i) result[i] = values[static_cast<Eigen::Index>(i)];
  return result;
}

SetCollisionBehaviorRequest to_request(const SetCollisionThresholds& set) {
  const ContactThresholds& slow = set.nominal;
  const ContactThresholds& fast = set.acceleration ? *set.acceleration : set.nominal;
  return {.lower_torque_thresholds_acceleration = to_array<7>(fast.torque_lower),
          .upper_torque_thresholds_acceleration = to_array<7>(fast.torque_upper),
          .lower_torque_thresholds_nominal = to_array<7>(slow.torque_lower),
          .upper_torque_thresholds_nominal = to_array<7>(slow.torque_upper),
          .lower_force_thresholds_acceleration = to_array<6>(fast.wrench_lower),
          .upper_force_thresholds_acceleration = to_array<6>(fast.wrench_upper),
          .lower_force_thresholds_nominal = to_array<6>(slow.wrench_lower),
          .upper_force_thresholds_nominal = to_array<6>(slow.wrench_upper)};
}

std::string grams(double mass) { return std::to_string(std::lround(mass * 1000)) + " g"; }

std::future<ArmAnswer> answered(ArmAnswer answer) {
  std::promise<ArmAnswer> promise;
  promise.set_value(std::move(answer));
  return promise.get_future();
}

bool is_about_end_effector(const ArmRequest& request) {
  return std::holds_alternative<GripperHoming>(request) || std::holds_alternative<GripperMove>(request) ||
         std::holds_alternative<GripperGrasp>(request) || std::holds_alternative<GripperStop>(request) ||
         std::holds_alternative<VacuumOn>(request) || std::holds_alternative<VacuumDrop>(request) ||
         std::holds_alternative<VacuumStop>(request);
}

bool is_setting(const ArmRequest& request) {
  return std::holds_alternative<SetLoad>(request) || std::holds_alternative<SetFrames>(request) ||
         std::holds_alternative<SetJointStiffness>(request) ||
         std::holds_alternative<SetCartesianStiffness>(request) ||
         std::holds_alternative<SetCollisionThresholds>(request) ||
         std::holds_alternative<SetGuidingMode>(request);
}

}  // namespace

ArmDriver::ArmDriver(FciArmConfig config, const FciOptions& options)
    : config_(std::move(config)),
      options_(options),
      link_({.name = config_.name,
             .address = config_.address,
             .port = config_.port,
             .version = config_.version,
             .loop_reads_states = true}),
      end_effector_(config_.end_effector ? config_.end_effector() : nullptr),
      wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      packet_(config_.model->X_WB(), config_.hand) {
  if (wake_ < 0) throw std::runtime_error("no eventfd for arm '" + config_.name + "' could be opened");
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
          .period_s = kPeriod};
}

ArmIdentity ArmDriver::identity() const {
  const std::lock_guard lock(mutex_);
  return identity_;
}

// ------------------------------------------------------------------------------------------------ commander

std::future<ArmAnswer> ArmDriver::post(Work work) {
  Task task{std::move(work), {}};
  auto future = task.promise.get_future();
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  (void)::eventfd_write(wake_, 1);
  return future;
}

void ArmDriver::run() {
  while (true) {
    std::array<pollfd, 2> watched{{{.fd = wake_, .events = POLLIN, .revents = 0},
                                   {.fd = link_.tcp_file(), .events = POLLIN, .revents = 0}}};
    (void)::poll(watched.data(), watched.size(), -1);
    eventfd_t count = 0;
    (void)::eventfd_read(wake_, &count);
    watch();
    if (stop_wanted_.exchange(false, std::memory_order_acq_rel)) {
      say("a command that is no torque was not sent, the motion is stopped: " + call("recover") + " goes on");
      (void)guarded([this] { return stop(); });
    }
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
    if (ending_) task.work = [] { return ArmAnswer{false, "the backend is being closed"}; };
  }
  task.promise.set_value(guarded(task.work));
  return true;
}

ArmAnswer ArmDriver::guarded(const Work& work) {
  try {
    return work();
  } catch (const LinkError& error) {
    if (error.is_fatal()) lost(error.what());
    return {false, error.what()};
  } catch (const std::exception& error) {
    return {false, config_.name + ": " + error.what()};
  }
}

// Between tasks: the end of a motion, the end of a connection.
void ArmDriver::watch() {
  if (!link_.is_connected()) return;
  try {
    const auto end = link_.poll_motion();
    if (!end || phase() != Phase::running) return;
    enter(Phase::stopped);
    if (!end->text.empty()) {
      // The state that shows why may come after the reply.
      constexpr double kSoon = 0.05;  // [s]
      (void)link_.wait_for_state([](const RobotState& s) { return !is_mode(s, RobotMode::move); }, kSoon);
      std::string errors = error_list(link_.look());
      if (!errors.empty()) errors.insert(0, " ");
      say(end->text + errors + ": the arm holds itself; " + call("recover") + " brings it back");
    }
  } catch (const LinkError& error) {
    lost(error.what());
  }
}

void ArmDriver::lost(const std::string& why) {
  const bool was_in_use = takes_part();
  link_.close();
  enter(Phase::offline);
  if (was_in_use) say(why + ": " + call("reconnect"));
}

void ArmDriver::say(const std::string& text) const {
  const bool named = text.find("arm " + config_.name) != std::string::npos;
  if (options_.say) options_.say(named ? text : "arm " + config_.name + ": " + text);
}

void ArmDriver::refuse(const std::string& text) const {
  throw LinkError(LinkError::Kind::refused, "arm " + config_.name + ": " + text);
}

std::string ArmDriver::call(const char* word) const {
  return std::string("`multipanda ctl ") + word + " " + config_.name + "`";
}

std::future<ArmAnswer> ArmDriver::prepare() {
  return post([this] {
    connect_and_configure();
    return ArmAnswer{true, {}};
  });
}

std::future<ArmAnswer> ArmDriver::begin() {
  return post([this] {
    start_torque_motion();
    return ArmAnswer{true, {}};
  });
}

std::future<ArmAnswer> ArmDriver::leave(bool finished) {
  return post([this, finished] {
    if (link_.is_connected() && link_.has_motion()) {
      constexpr double kEnd = 0.3;  // [s] for the reply to a motion that was finished in the loop
      try {
        (void)link_.wait_for_end(finished ? kEnd : 0);
      } catch (const LinkError& error) {
        if (error.kind() != LinkError::Kind::timeout) throw;
        link_.stop();
      }
    }
    enter(Phase::offline);
    link_.close();
    return ArmAnswer{true, {}};
  });
}

std::future<ArmAnswer> ArmDriver::request(ArmRequest request) {
  if (is_about_end_effector(request)) {
    if (end_effector_ == nullptr) {
      return answered({false, "arm " + config_.name + " has no gripper in this run: name one in the scene"});
    }
    if (!end_effector_connected_.load(std::memory_order_acquire)) {
      return answered(
          {false, "the gripper of arm " + config_.name + " is not connected: " + call("reconnect")});
    }
    return end_effector_->request(request);
  }
  if (std::holds_alternative<RecoverFromError>(request)) return post([this] { return recover(); });
  if (std::holds_alternative<Reconnect>(request)) return post([this] { return reconnect(); });
  if (std::holds_alternative<StopMotion>(request)) return post([this] { return stop(); });
  if (!is_setting(request)) {
    return answered({false, "a real arm does not know this request: it is for simulated worlds"});
  }
  return post([this, request = std::move(request)] {
    if (!takes_part()) refuse("it is not connected: " + call("reconnect"));
    apply_beside_motion(request);
    return ArmAnswer{true, {}};
  });
}

// ------------------------------------------------------------------------------- connecting, configuring

void ArmDriver::connect_and_configure() {
  enter(Phase::preparing);
  try {
    link_.connect();
    {
      const std::lock_guard lock(mutex_);
      identity_ = {.version = link_.version(), .generation = link_.version() <= 5 ? "Panda" : "FR3"};
    }
    check_model();
    configure();
    connect_end_effector();
  } catch (...) {
    link_.close();
    enter(Phase::offline);
    throw;
  }
  enter(Phase::stopped);
}

void ArmDriver::connect_end_effector() {
  if (end_effector_ == nullptr) return;
  try {
    end_effector_->connect();
    end_effector_connected_.store(true, std::memory_order_release);
  } catch (const std::exception& error) {  // an arm without its gripper is still an arm
    end_effector_connected_.store(false, std::memory_order_release);
    say(std::string(error.what()) + ": going on without it");
  }
}

void ArmDriver::check_model() {
  std::string report;
  bool checked = false;
  const ModelCheck wanted = config_.model_check.value_or(options_.model_check);
  if (wanted == ModelCheck::off) {
    report = "not compared, as asked";
  } else if (!link_.dialect().has_model_text()) {
    report = "not compared: an arm of version " + std::to_string(link_.version()) +
             " hands out its model as a program library only";
  } else {
    const ModelComparison found = compare_models(link_.robot_model(), config_.hand, *config_.model);
    report = found.text();
    checked = true;
    if (!found.same_kinematics()) {
      refuse("its own model has another geometry than the scene's (" + report +
             "): name the right model in the scene (fer, fr3, ...)");
    }
    if (!found.same_dynamics()) {
      if (wanted == ModelCheck::refuse) {
        refuse("its own model has other masses than the scene's (" + report + ")");
      }
      say("its own model differs from the scene's: " + report);
    } else if (!found.limits.empty()) {
      say("joint limits differ: " + found.limits);
    }
  }
  const std::lock_guard lock(mutex_);
  identity_.model_checked = checked;
  identity_.model_report = report;
}

void ArmDriver::configure() {
  // A motion of a connection that was lost ends by itself, as an error.
  (void)link_.wait_for_state([](const RobotState& s) { return !is_mode(s, RobotMode::move); });
  const RobotState& state = link_.look();
  if (is_mode(state, RobotMode::reflex)) {
    say("was stopped by an error before " + error_list(state) + "and is recovered");
    link_.recover();
  }
  if (!is_mode(link_.look(), RobotMode::idle)) refuse(refusal_in_mode(config_.name, link_.last_state()));
  check_end_effector(link_.last_state());
  set_frames(config_.frames);
  set_load(config_.load);
  if (config_.joint_stiffness) link_.set_joint_impedance(to_array<7>(*config_.joint_stiffness));
  if (config_.cartesian_stiffness) link_.set_cartesian_impedance(to_array<6>(*config_.cartesian_stiffness));
  if (config_.thresholds) link_.set_collision_behavior(to_request(*config_.thresholds));
}

// What the arm carries by its own settings must be what hangs there: it compensates its weight by them.
void ArmDriver::check_end_effector(const RobotState& state) {
  const Load theirs = end_effector_of(state), ours = with(config_.hand, config_.tool);
  constexpr double kGrams = 0.02, kMoment = 0.003;  // [kg], [kg m]
  if (std::abs(theirs.mass - ours.mass) <= kGrams &&
      (theirs.mass * theirs.p_FC - ours.mass * ours.p_FC).norm() <= kMoment) {
    return;
  }
  say("its settings declare an end effector of " + grams(theirs.mass) + ", the scene one of " +
      grams(ours.mass) +
      " (or another centre of mass): the arm compensates what its settings say, and sinks or rises by the "
      "rest. "
      "Correct the end effector in the arm's web interface, or hand and tool in the scene");
}

void ArmDriver::set_frames(const ArmFrames& frames) {
  const Pose X_FN = pose_of(link_.look().F_T_NE);
  link_.set_EE(with_proper_rotation(X_FN.inverse() * frames.X_FE));
  link_.set_K(frames.X_EK);
  if (!link_.wait_for_state([&](const RobotState& s) {
        return is_close(pose_of(s.F_T_EE), frames.X_FE) && is_close(pose_of(s.EE_T_K), frames.X_EK);
      })) {
    refuse(
        "it agreed to new frames, but its state shows others: look at the end effector in its web interface");
  }
}

void ArmDriver::set_load(const Load& load) {
  link_.set_load(load);
  if (!link_.wait_for_state([&](const RobotState& s) { return is_close(payload_of(s), load); })) {
    refuse("it agreed to a load of " + grams(load.mass) + ", but its state shows " +
           grams(link_.last_state().m_load));
  }
}

void ArmDriver::apply(const ArmRequest& request) {
  if (const auto* load = std::get_if<SetLoad>(&request)) {
    set_load(load->load);
  } else if (const auto* frames = std::get_if<SetFrames>(&request)) {
    const RobotState& state = link_.look();
    set_frames({frames->X_FE.value_or(pose_of(state.F_T_EE)), frames->X_EK.value_or(pose_of(state.EE_T_K))});
  } else if (const auto* joints = std::get_if<SetJointStiffness>(&request)) {
    link_.set_joint_impedance(to_array<7>(joints->stiffness));
  } else if (const auto* cartesian = std::get_if<SetCartesianStiffness>(&request)) {
    link_.set_cartesian_impedance(to_array<6>(cartesian->stiffness));
  } else if (const auto* thresholds = std::get_if<SetCollisionThresholds>(&request)) {
    link_.set_collision_behavior(to_request(*thresholds));
  } else if (const auto* guiding = std::get_if<SetGuidingMode>(&request)) {
    link_.set_guiding_mode(guiding->axes, guiding->elbow);
  }
}

// Arms take settings while they rest. One that moves by torques and stands still is let go for a moment: it
// holds itself meanwhile, and comes back into hold.
void ArmDriver::apply_beside_motion(const ArmRequest& request) {
  try {
    apply(request);
    return;
  } catch (const LinkError& error) {
    if (error.kind() != LinkError::Kind::refused || phase() != Phase::running) throw;
    constexpr double kStill = 0.02;  // [rad/s]
    const RobotState& state = link_.look();
    if (!is_mode(state, RobotMode::move) ||
        std::any_of(state.dq.begin(), state.dq.end(), [](double v) { return std::abs(v) > kStill; })) {
      throw;
    }
  }
  enter(Phase::starting);
  link_.stop();
  enter(Phase::stopped);
  apply(request);
  start_torque_motion();
}

// ------------------------------------------------------------------------------------ motion and recovery

void ArmDriver::start_torque_motion() {
  enter(Phase::starting);
  try {
    link_.start_motion({.controller = ArmController::external, .generator = MotionGenerator::none});
    link_.wait_until_running();
  } catch (const LinkError& error) {
    if (!error.is_fatal()) enter(Phase::stopped);
    throw;
  }
  enter(Phase::running);
}

ArmAnswer ArmDriver::recover() {
  if (!takes_part()) refuse("it is not connected: " + call("reconnect"));
  watch();
  if (!takes_part()) refuse("its connection was lost just now: " + call("reconnect"));
  const RobotState& state = link_.look();
  if (is_mode(state, RobotMode::move) && phase() == Phase::running) {
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
    } catch (const LinkError& error) {
      if (!error.is_fatal()) enter(Phase::stopped);
      throw;
    }
  }
  start_torque_motion();
  return {true, {}};
}

ArmAnswer ArmDriver::reconnect() {
  watch();
  const auto before = link_.statistics().received;
  if (takes_part() &&
      link_.wait_for_state([&](const RobotState&) { return link_.statistics().received != before; }, 0.1)) {
    refuse("its connection stands: there is nothing to connect again");
  }
  link_.close();
  connect_and_configure();
  start_torque_motion();
  return {true, {}};
}

ArmAnswer ArmDriver::stop() {
  if (!takes_part()) refuse("it is not connected: " + call("reconnect"));
  link_.stop();
  enter(Phase::stopped);
  return {true, {}};
}

// ----------------------------------------------------------------------------------------------------- loop

void ArmDriver::receive() noexcept {
  if (link_.receive()) unread_ = true;
}

ArmMode ArmDriver::mode(HostTime now) const noexcept {
  const Phase phase = this->phase();
  if (phase == Phase::offline || newest().message_id == 0) return ArmMode::disconnected;
  if (!options_.lockstep && seconds(now - link_.received_at()) > options_.lost_after_s) {
    return ArmMode::disconnected;
  }
  switch (static_cast<RobotMode>(newest().robot_mode)) {
    case RobotMode::move:
      return phase >= Phase::starting && takes_torques(newest()) ? ArmMode::move : ArmMode::other;
    case RobotMode::idle:
      return phase == Phase::starting || phase == Phase::preparing ? ArmMode::recovering : ArmMode::other;
    case RobotMode::guiding:
      return ArmMode::guiding;
    case RobotMode::reflex:
      return ArmMode::reflex;
    case RobotMode::user_stopped:
      return ArmMode::user_stopped;
    case RobotMode::automatic_error_recovery:
      return ArmMode::recovering;
    case RobotMode::other:
      break;
  }
  return ArmMode::other;
}

void ArmDriver::fill(HostTime now, ArmState& state) noexcept {
  state.mode = mode(now);
  if (state.mode != ArmMode::move) commanded_ = refused_ = false;
  packet_.fill(newest(), commanded_, state);
  state.t_host = link_.received_at();
  if (end_effector_ != nullptr && end_effector_connected_.load(std::memory_order_acquire)) {
    state.gripper = end_effector_->state();
  } else {
    state.gripper = {};
  }
}

void ArmDriver::command(const JointVector& tau_cmd) noexcept {
  if (refused_ || mode(link_.received_at()) != ArmMode::move) return;
  if (tau_cmd.size() != 7 || !tau_cmd.allFinite()) {
    refused_ = true;
    stop_wanted_.store(true, std::memory_order_release);
    (void)::eventfd_write(wake_, 1);
    return;
  }
  // The torque in use: what was sent last, unless the arm shows that it has not got it.
  const RobotState& state = newest();
  constexpr double kRounding = 1e-4;                 // [N m]: single precision of 87 N m is 4e-6
  constexpr double kStep = (1000 - 1e-3) * kPeriod;  // the maker's limit, less its margin [N m]
  const double gain =
      config_.low_pass_hz > 0 ? kPeriod / (kPeriod + 1 / (2 * std::numbers::pi * config_.low_pass_hz)) : 1;
  for (std::size_t i = 0; i < 7; ++i) {
    const double last = commanded_ ? sent_[i] : 0.0;
    const double shown = commanded_ ? state.tau_J_d[i] : 0.0;
    const double in_use = std::abs(shown - last) < kRounding ? last : shown;
    double tau = in_use + gain * (tau_cmd[static_cast<Eigen::Index>(i)] - in_use);
    if (gain == 1) tau = tau_cmd[static_cast<Eigen::Index>(i)];  // exactly
    const double from = config_.limit_rate ? in_use : last;
    tau = std::clamp(tau, from - kStep, from + kStep);
    command_.tau_J_d[i] = tau;
  }
  command_.motion_generation_finished = command_.torque_command_finished = false;
  if (!link_.send(command_)) return;
  sent_ = command_.tau_J_d;
  commanded_ = true;
}

void ArmDriver::command_finish() noexcept {
  if (mode(link_.received_at()) != ArmMode::move) return;
  command_.tau_J_d = commanded_ ? sent_ : std::array<double, 7>{};
  ArmLink::mark_finished(link_.dialect(), false, command_);
  (void)link_.send(command_);
}

}  // namespace multipanda::fci
