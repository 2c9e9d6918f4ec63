#include "runtime/embedded/answered_arm.hpp"

#include <algorithm>
#include <stdexcept>

#include "core/rt/thread_setup.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr int kAnswerPriority = 85;  // above a controller_manager, whose default is 50

std::vector<fci::FciArmConfig> alone(fci::FciArmConfig config) {
  std::vector<fci::FciArmConfig> one;
  one.push_back(std::move(config));
  return one;
}

// The kind of motion in which the arm accepts commands.
ArmDrive running_motion(const fci::FciBackend& backend) {
  for (std::size_t k = 1; k < kArmDrives; ++k) {
    const auto drive = static_cast<ArmDrive>(k);
    if (backend.is_running(0, fci_motion(drive))) return drive;
  }
  return ArmDrive::none;
}

void copy_desired(const fci::RobotState& packet, DesiredMotionState& desired) {
  std::copy(packet.q_d.begin(), packet.q_d.end(), desired.q_d.begin());
  std::copy(packet.dq_d.begin(), packet.dq_d.end(), desired.dq_d.begin());
  std::copy(packet.ddq_d.begin(), packet.ddq_d.end(), desired.ddq_d.begin());
  desired.O_T_EE_c = packet.O_T_EE_c;
  desired.O_dP_EE_c = packet.O_dP_EE_c;
  desired.O_ddP_EE_c = packet.O_ddP_EE_c;
}

}  // namespace

fci::ArmMotion fci_motion(ArmDrive drive) {
  switch (drive) {
    case ArmDrive::none:
      break;
    case ArmDrive::effort:
      return fci::ArmMotion::torque;
    case ArmDrive::joint_position:
      return fci::ArmMotion::joint_position;
    case ArmDrive::joint_velocity:
      return fci::ArmMotion::joint_velocity;
    case ArmDrive::cartesian_pose:
      return fci::ArmMotion::cartesian_pose;
    case ArmDrive::cartesian_velocity:
      return fci::ArmMotion::cartesian_velocity;
  }
  return fci::ArmMotion::none;
}

fci::RobotCommand fci_command(const InterfaceCommand& command) {
  fci::RobotCommand wire;
  if (command.q_c.size() == 7) std::copy(command.q_c.begin(), command.q_c.end(), wire.q_c.begin());
  if (command.dq_c.size() == 7) std::copy(command.dq_c.begin(), command.dq_c.end(), wire.dq_c.begin());
  wire.O_T_EE_c = command.O_T_EE_c;
  std::copy(command.O_dP_EE_c.begin(), command.O_dP_EE_c.end(), wire.O_dP_EE_c.begin());
  return wire;
}

AnsweredArm::AnsweredArm(fci::FciArmConfig config, const SceneArm& arm,
                         std::function<void(const std::string&)> report)
    : backend_(alone(config), {.begin_torque = false, .report = report}),
      answer_(config.model, FollowerLimits::of(robot_of(arm), &arm.safety.joints), config.low_pass_hz,
              &arm.safety.joints),
      say_(std::move(report)),
      states_(1),
      torques_{{joint_constant(config.model->joint_count(), 0)}} {}

std::future<std::string> AnsweredArm::enter() {
  std::promise<std::string> connected;
  auto result = connected.get_future();
  leaving_.store(false, std::memory_order_release);
  thread_ = std::thread([this, connected = std::move(connected)]() mutable { run(std::move(connected)); });
  return result;
}

void AnsweredArm::leave() {
  if (!thread_.joinable()) return;
  begin_leaving();
  thread_.join();
}

void AnsweredArm::run(std::promise<std::string> connected) {
  answer_.reset();
  backend_.request_motion(0, fci::ArmMotion::none);
  try {
    backend_.start();
  } catch (const std::exception& error) {
    connected.set_value(error.what());
    return;
  }
  for (const SetupStep& step :
       set_up_thread({.lock_memory = true, .fifo_priority = kAnswerPriority, .cpu = {}})) {
    if (!step.done && say_) say_("the thread that answers the arm: " + step.what + " failed: " + step.reason);
  }
  connected.set_value({});
  while (!leaving_.load(std::memory_order_acquire)) cycle();
  // Answers the arm until it has left its motion. Longer than ArmAnswer::kLongestStop plus the time that the
  // arm needs to end a motion.
  constexpr double kEnd = 1.5;  // [s]
  const HostTime since = host_now();
  while (now_.state.mode == ArmMode::move && seconds(host_now() - since) < kEnd) cycle();
  backend_.finish();
}

void AnsweredArm::cycle() {
  const ArmSet due = backend_.wait();
  backend_.read(due, states_);
  now_.state = states_[0];
  if (due.contains(0)) {
    (void)orders_.take();
    const fci::RobotState& packet = backend_.packet(0);
    copy_desired(packet, desired_);
    now_.running = running_motion(backend_);
    switch (answer_.step(orders_.value(), states_[0], desired_, now_.running)) {
      case ArmAnswer::Kind::torque:
        torques_[0].tau_cmd = answer_.torque();
        backend_.write(due, torques_);
        break;
      case ArmAnswer::Kind::motion: {
        fci::RobotCommand command = fci_command(answer_.motion());
        backend_.command(0, command);
        break;
      }
      case ArmAnswer::Kind::none:
        break;
    }
    if (const auto drive = answer_.take_request()) backend_.request_motion(0, fci_motion(*drive));
    std::copy(packet.q_d.begin(), packet.q_d.end(), now_.desired.q_d.begin());
    now_.desired.O_T_EE_d = packet.O_T_EE_d;
    now_.follows = answer_.follows();
    now_.holds = answer_.holds();
  } else if (now_.state.mode != ArmMode::move) {
    now_.running = ArmDrive::none;
    now_.follows = false;
  }
  reports_.write(now_);
}

void AnsweredArm::set_drive(ArmDrive drive) noexcept {
  ++order_.change;
  order_.drive = drive;
  order_.number = 0;
  order_.resumed = report().holds;
  orders_.write(order_);
}

void AnsweredArm::command(std::int64_t stamp_ns, std::span<const double> values) noexcept {
  ++order_.number;
  order_.stamp_ns = stamp_ns;
  std::copy(values.begin(), values.end(), order_.values.begin());
  orders_.write(order_);
}

bool AnsweredArm::take_restart() noexcept {
  if (order_.resumed == report().holds) return false;
  order_.resumed = report().holds;
  return true;
}

}  // namespace multipanda
