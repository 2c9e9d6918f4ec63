#include <cmath>

#include "fci/client/arm_driver.hpp"
#include "fci/client/arm_words.hpp"
#include "fci/client/model_check.hpp"

// What an arm's commander does between connecting and the first motion: who is it, is it what the scene says,
// and what it has to know.
namespace multipanda::fci {
namespace {

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
  start_wanted_motion();
}

}  // namespace multipanda::fci
