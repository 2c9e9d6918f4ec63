#include "runtime/embedded/hardware_system.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <thread>

#include "core/types/time.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kJointBits = kMaxJoints;
constexpr std::size_t kPoseBit = 3 * kJointBits, kTwistBit = kPoseBit + 16;
constexpr std::array<const char*, 6> kTwistNames{"tx", "ty", "tz", "omega_x", "omega_y", "omega_z"};

std::string two_digits(std::size_t i) {
  return {static_cast<char>('0' + i / 10), static_cast<char>('0' + i % 10)};
}

bool in_fault(ArmMode mode) {
  return mode == ArmMode::reflex || mode == ArmMode::user_stopped || mode == ArmMode::guiding ||
         mode == ArmMode::disconnected || mode == ArmMode::other;
}

}  // namespace

HardwareSystem::HardwareSystem(Scene scene, std::unique_ptr<HardwareArms> arms)
    : scene_(std::move(scene)), hardware_(std::move(arms)) {
  if (hardware_->backend().arm_count() != scene_.arms.size()) {
    throw std::invalid_argument("the scene has " + std::to_string(scene_.arms.size()) +
                                " arms, but the hardware has " +
                                std::to_string(hardware_->backend().arm_count()));
  }
  for (ArmIndex i = 0; i < scene_.arms.size(); ++i) {
    Arm& arm = arms_.emplace_back();
    arm.name = scene_.arms[i].name;
    arm.model = build_arm_model(scene_.arms[i]);
    arm.joints = arm.model->joint_count();
    arm.terms = std::make_unique<ModelTerms>(arm.model);
    arm.shared.capabilities = hardware_->backend().capabilities(i);
    arm.shared.model = arm.terms.get();
    arm.shared.backend = &hardware_->backend();
    arm.shared.arm = i;
    arm.command.q_c = arm.command.dq_c = arm.command.tau_J_d = joint_constant(arm.joints, 0);
    torques_.push_back({arm.command.tau_J_d});
    read_.emplace_back();
    list_numbers(i);
  }
}

HardwareSystem::~HardwareSystem() {
  tear_down_.wait();
  if (connected_) disconnect();
}

void HardwareSystem::add_command(ArmIndex arm, std::size_t bit, std::string prefix, std::string name,
                                 double* value) {
  commands_.push_back({std::move(prefix), std::move(name), value});
  places_[commands_.back().full_name()] = {arm, bit};
}

void HardwareSystem::list_numbers(ArmIndex index) {
  Arm& arm = arms_[index];
  for (std::size_t i = 0; i < arm.joints; ++i) {
    const std::string joint = arm.name + "_joint" + std::to_string(i + 1);
    states_.push_back({joint, "position", &arm.q[i]});
    states_.push_back({joint, "velocity", &arm.dq[i]});
    states_.push_back({joint, "effort", &arm.tau[i]});
    add_command(index, i, joint, "effort", &arm.effort_c[i]);
    add_command(index, kJointBits + i, joint, "position", &arm.position_c[i]);
    add_command(index, 2 * kJointBits + i, joint, "velocity", &arm.velocity_c[i]);
  }
  const std::string pose = arm.name + "_ee_cartesian_position", twist = arm.name + "_ee_cartesian_velocity";
  for (std::size_t i = 0; i < kPose; ++i) {
    states_.push_back({pose, two_digits(i), &arm.pose[i]});
    add_command(index, kPoseBit + i, pose, two_digits(i), &arm.pose_c[i]);
  }
  for (std::size_t i = 0; i < kTwist; ++i) {
    states_.push_back({twist, kTwistNames[i], &arm.twist[i]});
    add_command(index, kTwistBit + i, twist, kTwistNames[i], &arm.twist_c[i]);
  }
  states_.push_back({arm.name, kStateInterface, &arm.shared_value});
  states_.push_back({arm.name, kModelInterface, &arm.shared_value});
  states_.push_back({arm.name, "mode", &arm.mode});
  states_.push_back({arm.name, "error", &arm.error});
  states_.push_back({arm.name, "command_success_rate", &arm.success_rate});
  states_.push_back({arm.name, "following", &arm.following});
}

void HardwareSystem::connect() {
  tear_down_.wait();
  released_ = false;
  hardware_->connect();
  connected_ = true;
  for (Arm& arm : arms_) arm.shared_value = to_interface(&arm.shared);
  // Waits for the first states, which other components read at their start.
  constexpr double kTimeout = 1;  // [s]
  const HostTime start = host_now();
  const auto complete = [this] {
    return std::all_of(arms_.begin(), arms_.end(),
                       [](const Arm& arm) { return arm.shared.state.q.size() > 0; });
  };
  while (read() == Result::ok && !complete() && seconds(host_now() - start) < kTimeout) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void HardwareSystem::disconnect() {
  tear_down_.wait();
  if (released_) return;
  release();
  close();
}

void HardwareSystem::disconnect_later() {
  if (!connected_) return;
  release();
  released_ = true;
  tear_down_.start([this] { close(); });
}

void HardwareSystem::release() noexcept {
  deactivate();
  for (Arm& arm : arms_) arm.shared_value = 0;
  connected_ = false;
}

void HardwareSystem::close() {
  hardware_->disconnect();
  for (Arm& arm : arms_) arm.shared.state = {};  // connect() waits for new states
  for (ArmState& state : read_) state = {};
}

const HardwareSystem::Place* HardwareSystem::find(const std::string& full_name) const {
  const auto it = places_.find(full_name);
  return it == places_.end() ? nullptr : &it->second;
}

void HardwareSystem::change(const std::vector<std::string>& names, bool claimed,
                            std::vector<Claims>& claims) const {
  for (const auto& name : names) {
    if (const Place* place = find(name)) claims[place->arm].set(place->bit, claimed);
  }
}

bool HardwareSystem::drive_of(const Arm& arm, const Claims& claims, ArmDrive& drive) const {
  const auto whole = [&](std::size_t first, std::size_t count) {
    Claims all;
    for (std::size_t i = 0; i < count; ++i) all.set(first + i);
    return claims == all;
  };
  drive = ArmDrive::none;
  if (claims.none()) return true;
  if (whole(0, arm.joints)) drive = ArmDrive::effort;
  if (whole(kJointBits, arm.joints)) drive = ArmDrive::joint_position;
  if (whole(2 * kJointBits, arm.joints)) drive = ArmDrive::joint_velocity;
  if (whole(kPoseBit, kPose)) drive = ArmDrive::cartesian_pose;
  if (whole(kTwistBit, kTwist)) drive = ArmDrive::cartesian_velocity;
  return drive != ArmDrive::none;
}

bool HardwareSystem::prepare_switch(const std::vector<std::string>& start,
                                    const std::vector<std::string>& stop, std::string& why) const {
  std::vector<Claims> before, after;
  for (const Arm& arm : arms_) before.push_back(arm.claims);
  after = before;
  change(stop, false, after);
  std::vector<Claims> left = after;
  for (const auto& name : start) {
    const Place* place = find(name);
    if (place == nullptr) continue;
    if (left[place->arm].test(place->bit)) {
      why = "'" + name + "' is already claimed and not released";
      return false;
    }
    after[place->arm].set(place->bit);
  }
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    ArmDrive drive{};
    if (drive_of(arms_[i], after[i], drive)) continue;
    const bool partly = left[i].any() && after[i] != left[i];
    why = "arm '" + arms_[i].name + "': ";
    why += partly ? "it is driven by " + std::string(name_of(arms_[i].drive)) +
                        " already; stop that controller in the same switch"
                  : std::string("claim all of one kind: ") + std::to_string(arms_[i].joints) +
                        " joints' effort, position or velocity, 16 numbers of <arm>_ee_cartesian_position or "
                        "6 of <arm>_ee_cartesian_velocity";
    return false;
  }
  why.clear();
  return true;
}

void HardwareSystem::perform_switch(const std::vector<std::string>& start,
                                    const std::vector<std::string>& stop) noexcept {
  for (const auto& name : stop) {
    if (const Place* place = find(name)) arms_[place->arm].claims.reset(place->bit);
  }
  for (const auto& name : start) {
    if (const Place* place = find(name)) arms_[place->arm].claims.set(place->bit);
  }
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    ArmDrive drive{};
    if (!drive_of(arm, arm.claims, drive))
      drive = ArmDrive::none;  // not prepared: no controller drives the
                               // arm
    if (released_) continue;
    // A claim of the same kind by another controller also counts as a start; interfaces in use keep
    // their commands.
    if (drive == arm.drive) continue;
    arm.drive = drive;
    arm.was_driven = arm.has_driven = arm.had_fault = false;
    arm.following = 0;
    seed(i);
    hardware_->set_drive(i, drive);
    arm.join.begin(false);
  }
}

// Earlier commands are no longer valid: each starts at the arm's present value.
void HardwareSystem::seed(ArmIndex index) {
  Arm& arm = arms_[index];
  const HardwareArms::Desired desired = hardware_->desired(index);
  arm.effort_c.fill(0);
  arm.velocity_c.fill(0);
  arm.twist_c.fill(0);
  arm.position_c = desired.q_d;
  arm.pose_c = desired.O_T_EE_d;
}

void HardwareSystem::deactivate() noexcept {
  if (released_) return;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    arm.claims.reset();
    if (arm.drive == ArmDrive::none) continue;
    arm.drive = ArmDrive::none;
    arm.was_driven = false;
    seed(i);
    hardware_->set_drive(i, ArmDrive::none);
  }
}

HardwareSystem::Result HardwareSystem::read() noexcept {
  if (released_) return Result::ok;  // another thread closes the connections
  const ArmSet due = hardware_->update();
  hardware_->backend().read(due, read_);
  bool any = false;
  ArmSet stopped;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    if (arm.shared.stopped > 0 && --arm.shared.stopped > 0) stopped |= ArmSet::of(i);
    if (due.contains(i)) {
      arm.shared.state = read_[i];
      publish(arm);
    } else if (read_[i].mode == ArmMode::disconnected) {
      arm.shared.state.mode = ArmMode::disconnected;
      arm.error = 1;
    }
    arm.mode = static_cast<double>(arm.shared.state.mode);
    arm.mode_now = static_cast<std::uint8_t>(arm.shared.state.mode);
    arm.grasped_now = arm.shared.state.gripper.grasped;
    any = any || arm.shared.state.mode != ArmMode::disconnected;
    if (in_fault(arm.shared.state.mode) && arm.has_driven) arm.had_fault = true;
  }
  if (MultimodeController* modes = shows_stopped_.load(std::memory_order_acquire))
    modes->show_stopped(stopped);
  return any && fault_free() ? Result::ok : Result::lost;
}

void HardwareSystem::publish(Arm& arm) {
  const ArmState& state = arm.shared.state;
  std::copy(state.q.begin(), state.q.end(), arm.q.begin());
  std::copy(state.dq.begin(), state.dq.end(), arm.dq.begin());
  std::copy(state.tau_J.begin(), state.tau_J.end(), arm.tau.begin());
  arm.error = state.errors != 0 || state.mode == ArmMode::reflex ? 1 : 0;
  arm.success_rate = state.command_success_rate;
  if (!state.q.allFinite() || !state.dq.allFinite()) return;
  arm.terms->update(state);
  const Pose X_BE = arm.model->X_WB().inverse() * arm.terms->X_WE();
  Eigen::Map<Eigen::Matrix4d> T(arm.pose.data());
  T.setIdentity();
  T.block<3, 3>(0, 0) = X_BE.rotation;
  T.block<3, 1>(0, 3) = X_BE.position;
  const Twist& V = arm.terms->V_WE();
  const Matrix3 R_BW = arm.model->X_WB().rotation.transpose();
  const Vector3 v = R_BW * V.linear(), w = R_BW * V.angular();
  std::copy(v.begin(), v.end(), arm.twist.begin());
  std::copy(w.begin(), w.end(), arm.twist.begin() + 3);
}

HardwareSystem::Result HardwareSystem::write(std::int64_t stamp_ns) noexcept {
  if (released_) return Result::ok;
  passed_ = hardware_->set_time(stamp_ns);
  ArmSet effort;
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    if (arm.drive == ArmDrive::effort) {
      effort |= ArmSet::of(i);
      std::copy_n(arm.effort_c.begin(), arm.joints, torques_[i].tau_cmd.data());
      arm.following = arm.shared.state.mode == ArmMode::move && hardware_->follows(i) ? 1 : 0;
    } else if (arm.drive == ArmDrive::none) {
      arm.following = 0;
    } else {
      drive_arm(i);
    }
  }
  hardware_->write(effort, torques_);
  return fault_free() ? Result::ok : Result::lost;
}

void HardwareSystem::drive_arm(ArmIndex index) {
  Arm& arm = arms_[index];
  if (!hardware_->is_driven(index, arm.drive)) {
    if (arm.shared.state.mode == ArmMode::move && arm.was_driven) return;  // no new packet in this cycle
    arm.was_driven = false;
    arm.following = 0;
    return;
  }
  if (hardware_->take_restart(index)) {  // commands from before a pause are not resumed
    arm.was_driven = false;
    arm.had_fault = true;
  }
  if (!arm.was_driven) arm.join.begin(arm.had_fault);
  arm.was_driven = arm.has_driven = true;
  arm.had_fault = false;
  arm.following = 0;
  const HardwareArms::Desired desired = hardware_->desired(index);
  const auto joints = [&](const auto& values) { return std::span(values).first(arm.joints); };
  InterfaceCommand& command = arm.command;
  CommandJoin::Result result = CommandJoin::Result::waiting;
  switch (arm.drive) {
    case ArmDrive::joint_position:
      result = arm.join.positions(joints(arm.position_c), joints(desired.q_d), passed_,
                                  std::span(command.q_c.data(), arm.joints));
      break;
    case ArmDrive::joint_velocity:
      result =
          arm.join.velocities(joints(arm.velocity_c), passed_, std::span(command.dq_c.data(), arm.joints));
      break;
    case ArmDrive::cartesian_pose:
      result = arm.join.pose(arm.pose_c, desired.O_T_EE_d, passed_, command.O_T_EE_c);
      break;
    case ArmDrive::cartesian_velocity:
      result = arm.join.velocities(arm.twist_c, passed_, std::span(command.O_dP_EE_c.data(), kTwist));
      break;
    case ArmDrive::none:
    case ArmDrive::effort:
      return;
  }
  if (result == CommandJoin::Result::not_finite) {
    // Invalid command. The arm stops; the next switch selects its drive again.
    hardware_->stop(index);
    arm.drive = ArmDrive::none;
    return;
  }
  arm.following = result == CommandJoin::Result::following && hardware_->follows(index) ? 1 : 0;
  hardware_->command(index, command);
}

std::string HardwareSystem::fault() const {
  if (auto why = hardware_->fault(); !why.empty()) return why;
  return "the connections to all arms are lost";
}

RunContext HardwareSystem::run_context() {
  if (!resting_) {
    registry_ = std::make_unique<Registry>(Registry::with_builtins());
    Scene arms = scene_;
    arms.controllets.clear();
    arms.active.clear();
    resting_ = std::make_unique<ControlCycle>(build_cycle_config(arms), *registry_, hardware_->backend());
    shows_stopped_.store(&resting_->modes(), std::memory_order_release);
  }
  RunContext world{.scene = &scene_,
                   .modes = &resting_->modes(),
                   .backend = &hardware_->backend(),
                   .layout = &resting_->layout(),
                   .models = {},
                   .followed = {},
                   .newest = [this](ArmIndex arm) {
                     ArmSample sample;
                     sample.mode = arms_[arm].mode_now;
                     sample.gripper_grasped = arms_[arm].grasped_now;
                     return sample;
                   }};
  for (const Arm& arm : arms_) world.models.push_back(arm.model);
  return world;
}

}  // namespace multipanda
