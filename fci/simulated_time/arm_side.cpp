#include "fci/simulated_time/arm_side.hpp"

#include <algorithm>
#include <utility>

#include "fci/server/wire.hpp"

namespace multipanda::fci {

ArmSide::ArmSide(SimulatedArm& arm, FixedConfig fixed, const Dialect& dialect, std::uint64_t first_number,
                 const Rules& rules)
    : arm_(arm),
      fixed_(std::move(fixed)),
      dialect_(dialect),
      rules_(rules),
      number_(first_number - 1),
      motions_ended_(arm.motions_ended()),
      accepted_(joint_constant(kWireJoints, 0)) {
  arm_.count_own_torque(rules_.first_torque == FirstTorque::of_own_hold);
}

std::span<const std::byte> ArmSide::period(std::int64_t now_ns) {
  notice_end();  // measurements since the last period may have ended the motion
  command();
  notice_end();
  ++number_;
  fill(state_, number_, arm_, fixed_);
  if (!runs_ && arm_.state().mode == ArmMode::move) show_idle(state_, arm_);
  show_torque();
  sent_ns_ = now_ns;
  ++counts_.states_sent;
  return {bytes_.data(), encode(dialect_, state_, bytes_)};
}

// During a motion tau_J_d is the last accepted command, from the following state on, regardless of the
// motors. Before the first one: see FirstTorque.
void ArmSide::show_torque() {
  if (!runs_) return;
  if (!taken_ && rules_.first_torque == FirstTorque::of_own_hold) accepted_ = arm_.state().tau_J_d;
  show_torque_taken(state_, accepted_);
}

void ArmSide::take_answer(std::span<const std::byte> datagram, std::int64_t now_ns) {
  if (decode(dialect_, datagram, received_) != WireResult::ok) return;
  const std::uint64_t id = received_.message_id;
  if (id > number_ || !runs_ || id < first_state_) return;  // the first of a motion may be older
  if (commanded_) {
    if (id <= newest_answer_) return;  // a duplicate, or overtaken
    if (id < number_ || now_ns - sent_ns_ > rules_.answer_ns) {
      ++counts_.answers_late;
      if (rules_.late == LateAnswers::dropped || has_pending_) return;
    }
  }
  newest_answer_ = id;
  commanded_ = has_pending_ = true;
  pending_ = received_;
}

void ArmSide::command() {
  if (runs_ && std::exchange(has_pending_, false)) {
    fill(command_, pending_);
    const bool finishes = pending_.motion_generation_finished || pending_.torque_command_finished;
    arm_.take_command(command_);
    ++counts_.answers_used;
    missed_ = 0;
    if (finishes) return;
    counts_.torque_rate_max =
        std::max(counts_.torque_rate_max, (command_.tau_J_d - accepted_).cwiseAbs().maxCoeff() / kArmPeriod);
    accepted_ = command_.tau_J_d;
    taken_ = true;
  } else if (runs_ && commanded_) {
    arm_.miss_command();
    ++counts_.periods_missed;
    counts_.longest_miss = std::max(counts_.longest_miss, ++missed_);
  }
}

void ArmSide::notice_end() {
  const auto ended = arm_.motions_ended();
  if (ended == motions_ended_) return;
  motions_ended_ = ended;
  if (!std::exchange(runs_, false)) return;
  ++ended_;
  if (arm_.motion_end() != MotionEnd::finished && arm_.motion_end() != MotionEnd::preempted) {
    ++counts_.motions_ended;
  }
}

MotionStart ArmSide::start_motion() {
  if (runs_) return MotionStart::not_possible;
  const MotionStart start = arm_.start_motion(
      motion_request({.controller = MoveController::external,
                      .generator = dialect_.torque_only_needs_generator() ? MoveGenerator::joint_velocity
                                                                          : MoveGenerator::none}));
  if (start != MotionStart::started) return start;
  motions_ended_ = arm_.motions_ended();
  runs_ = true;
  commanded_ = has_pending_ = taken_ = false;
  first_state_ = number_ + 1;
  newest_answer_ = 0;
  missed_ = 0;
  accepted_.setZero();
  return start;
}

void ArmSide::stop_motion() {
  arm_.stop_motion();
  notice_end();
}

bool ArmSide::recover() {
  if (runs_) return false;
  arm_.apply(RecoverFromError{});
  return arm_.mode() == ArmMode::idle || arm_.mode() == ArmMode::recovering;
}

bool ArmSide::apply(const ArmRequest& request) {
  return !runs_ && check_request(request, arm_.model()).empty() && arm_.apply(request) == ArmReply::done;
}

}  // namespace multipanda::fci
