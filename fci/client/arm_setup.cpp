#include <array>
#include <cmath>
#include <cstdio>

#include "fci/client/arm_driver.hpp"
#include "fci/client/arm_mode.hpp"
#include "fci/client/model_check.hpp"

// The commander's work between connecting and the first motion: checks identity and model,
// sends the configuration.
namespace multipanda::fci {
namespace {

bool is_close(const Pose& a, const Pose& b) {
  constexpr double kSame = 1e-4;  // arms round rotations to 0.7071; single precision would be 1e-7
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

// Upper bound on the joint torque from the weight difference of two bodies on the flange, over all poses.
double worst_torque(const Load& a, const Load& b) {
  constexpr double kGravity = 9.81, kReach = 0.855;  // of the flange, by the arms' data sheets [m]
  return kGravity * (std::abs(a.mass - b.mass) * kReach + (a.mass * a.p_FC - b.mass * b.p_FC).norm());
}

}  // namespace

void ArmDriver::connect_and_configure() {
  enter(Phase::preparing);
  try {
    link_.connect();
    {
      const std::lock_guard lock(mutex_);
      identity_ = {.version = link_.version(), .generation = link_.version() <= 5 ? "Panda" : "FR3"};
    }
    check_model();
    configured_ = configure();
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
  } catch (const std::exception& error) {  // the arm works without its gripper
    end_effector_connected_.store(false, std::memory_order_release);
    notify(std::string(error.what()) + ": the run continues without it");
  }
  link_.gaps().restart();  // one that is switched off may take long
}

void ArmDriver::check_model() {
  std::string report;
  bool checked = false;
  const ModelCheck check = config_.model_check.value_or(options_.model_check);
  if (check == ModelCheck::off) {
    report = "not compared, as requested";
  } else if (!link_.dialect().has_model_text()) {
    report = "not compared: an arm of version " + std::to_string(link_.version()) +
             " provides its model only as a shared library";
  } else {
    const ModelComparison found = compare_models(link_.robot_model(), config_.hand, *config_.model);
    report = found.text();
    checked = true;
    if (!found.same_kinematics()) {
      refuse("the geometry of its own model differs from the scene's (" + report +
             "): set the right model in the scene (fer, fr3, ...)");
    }
    if (!found.same_dynamics()) {
      if (check == ModelCheck::refuse) {
        refuse("the masses of its own model differ from the scene's (" + report + ")");
      }
      notify("its own model differs from the scene's: " + report);
    } else if (!found.limits.empty()) {
      notify("joint limits differ: " + found.limits);
    }
  }
  const std::lock_guard lock(mutex_);
  identity_.model_checked = checked;
  identity_.model_report = report;
}

// False: the arm is in a reflex and was left unchanged.
bool ArmDriver::configure() {
  // A motion of a lost connection ends with an error by itself.
  (void)link_.wait_for_state([](const RobotState& s) { return !is_mode(s, RobotMode::move); });
  const RobotState& state = link_.look();
  if (is_mode(state, RobotMode::reflex)) {
    // The arm may have stopped at a person: starting a program must not reactivate it.
    if (!config_.recover_at_start) {
      notify(in_reflex(state));
      return false;
    }
    notify("an earlier error stopped it " + error_list(state) +
           "and it is recovered because of `recover_at_start`");
    link_.recover();
  }
  send_settings();
  return true;
}

std::string ArmDriver::in_reflex(const RobotState& state) const {
  return "an earlier error has stopped it " + error_list(state) +
         "and it stays stopped: make sure that nobody is in its way, then run " + ctl_command("recover");
}

void ArmDriver::send_settings() {
  if (!is_mode(link_.look(), RobotMode::idle)) refuse(refusal_in_mode(config_.name, link_.last_state()));
  check_end_effector(link_.last_state());
  try {
    set_frames(settings_.frames);
    send_load();
    if (settings_.joint_stiffness) link_.set_joint_impedance(to_array<7>(*settings_.joint_stiffness));
    if (settings_.cartesian_stiffness) {
      link_.set_cartesian_impedance(to_array<6>(*settings_.cartesian_stiffness));
    }
    if (settings_.thresholds) link_.set_collision_behavior(to_request(*settings_.thresholds));
  } catch (const ConnectionError& error) {
    if (error.is_fatal() || settings_.changed.empty()) throw;
    throw ConnectionError(error.kind(), std::string(error.what()) +
                                            "; requests of this run have changed its " + settings_.changed +
                                            ": reconnect once the cause is gone, or start the run again "
                                            "with the scene's");
  }
  if (load_is_unknown_) {
    notify(unknown_load());
  } else if (!settings_.changed.empty()) {
    notify("it has the " + settings_.changed + " that requests of this run have set" +
           (settings_.has_changed("load") ? "; it compensates a load of " + grams(settings_.load.mass) : ""));
  }
}

std::string ArmDriver::unknown_load() const {
  return "this run declared a load of " + grams(settings_.load.mass) + ", and the arm has one of " +
         grams(link_.last_state().m_load) +
         " now, or with another center of mass or inertia: set the load that it carries";
}

// An arm whose load differs from the declared one was switched off or used by another program, so its actual
// load is unknown: with a wrong load it would rise or sink as soon as it is under control.
void ArmDriver::send_load() {
  load_is_unknown_ =
      settings_.has_changed("load") && !is_close(payload_of(link_.last_state()), settings_.load);
  if (!load_is_unknown_) set_load(settings_.load);
}

// The end effector in the arm's settings must match the scene: the arm compensates its weight.
void ArmDriver::check_end_effector(const RobotState& state) {
  const Load theirs = end_effector_of(state),
             ours = with(config_.hand_declared.value_or(config_.hand), config_.tool);
  const double torque =
      std::min(worst_torque(theirs, ours), worst_torque(theirs, with(config_.hand, config_.tool)));
  constexpr double kUnnoticed = 0.4;  // about the friction of a joint, which holds an arm at rest [N m]
  if (torque <= kUnnoticed) return;
  std::array<char, 32> most{};
  std::snprintf(most.data(), most.size(), "%.1f N m", torque);
  notify("its settings declare an end effector of " + grams(theirs.mass) + ", the scene one of " +
         grams(ours.mass) +
         " (or another center of mass): the arm compensates the declared one and sinks or "
         "rises by the difference, up to " +
         most.data() +
         " at a joint. Correct the end effector in the arm's web interface, or hand and tool in the scene");
}

void ArmDriver::set_frames(const ArmFrames& frames) {
  const Pose X_NEE =
      with_proper_rotation(with_proper_rotation(pose_of(link_.look().F_T_NE)).inverse() * frames.X_FE);
  link_.set_EE(X_NEE);
  link_.set_K(frames.X_EK);
  if (!link_.wait_for_state([&](const RobotState& s) {
        return is_close(pose_of(s.NE_T_EE), X_NEE) && is_close(pose_of(s.EE_T_K), frames.X_EK);
      })) {
    refuse(
        "it accepted new frames, but its state shows different ones: check the end effector in its web "
        "interface");
  }
}

void ArmDriver::set_load(const Load& load) {
  link_.set_load(load);
  confirm_load(load);
}

void ArmDriver::confirm_load(const Load& load) {
  if (!link_.wait_for_state([&](const RobotState& s) { return is_close(payload_of(s), load); })) {
    refuse("it accepted a load of " + grams(load.mass) + ", but its state shows " +
           grams(link_.last_state().m_load));
  }
}

void ArmDriver::apply(const ArmRequest& request) {
  std::visit([this](const auto& r) { set(r); }, request);
}

// Forgotten only if the arm refuses it: after a lost connection the arm may or may not have it, and its load
// is read after the reconnection.
void ArmDriver::set(const SetLoad& request) {
  const RobotState& state = link_.look();
  if (!is_mode(state, RobotMode::idle) && !is_mode(state, RobotMode::move))
    refuse(refusal_in_mode(config_.name, state));
  const Settings before = settings_;
  settings_.load = request.load;
  remember("load");
  try {
    link_.set_load(request.load);
  } catch (const ConnectionError& error) {
    if (!error.is_fatal()) settings_ = before;
    throw;
  }
  confirm_load(request.load);
  load_is_unknown_ = false;
}

// A frame that is not given keeps this run's value; the arm's value may be that of an earlier program.
void ArmDriver::set(const SetFrames& request) {
  const ArmFrames frames{request.X_FE.value_or(settings_.frames.X_FE),
                         request.X_EK.value_or(settings_.frames.X_EK)};
  set_frames(frames);
  settings_.frames = frames;
  remember("frames");
}

void ArmDriver::set(const SetJointStiffness& request) {
  link_.set_joint_impedance(to_array<7>(request.stiffness));
  settings_.joint_stiffness = request.stiffness;
  remember("joint stiffness");
}

void ArmDriver::set(const SetCartesianStiffness& request) {
  link_.set_cartesian_impedance(to_array<6>(request.stiffness));
  settings_.cartesian_stiffness = request.stiffness;
  remember("Cartesian stiffness");
}

void ArmDriver::set(const SetCollisionThresholds& request) {
  link_.set_collision_behavior(to_request(request));
  settings_.thresholds = request;
  remember("collision thresholds");
}

void ArmDriver::set(const SetGuidingMode& request) { link_.set_guiding_mode(request.axes, request.elbow); }

void ArmDriver::remember(const char* changed) {
  if (settings_.has_changed(changed)) return;
  settings_.changed += (settings_.changed.empty() ? "" : ", ") + std::string(changed);
}

// Arms accept settings only at rest. Torque control of an arm at rest is interrupted for the
// setting: the arm holds itself meanwhile and is in hold afterwards.
void ArmDriver::apply_beside_motion(const ArmRequest& request) {
  try {
    apply(request);
    return;
  } catch (const ConnectionError& error) {
    if (error.kind() != ConnectionError::Kind::refused || phase() != Phase::running) throw;
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
  try {
    apply(request);
  } catch (const ConnectionError& error) {
    // A refused setting must not leave the arm without its torque control.
    if (!error.is_fatal()) start_requested_motion();
    throw;
  }
  start_requested_motion();
}

}  // namespace multipanda::fci
