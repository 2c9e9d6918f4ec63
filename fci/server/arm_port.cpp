#include "fci/server/arm_port.hpp"

#include <algorithm>
#include <sys/epoll.h>
#include <sys/socket.h>

#include "core/model/prismatic_joints.hpp"
#include "core/types/time.hpp"
#include "fci/server/wire.hpp"

namespace multipanda::fci {
namespace {

// Both replies to a Move carry the same id, and libfranka loses the second one if it arrives before the first
// was read. The program's next message shows that it has read the first; without a message, it has read it
// after this time.
constexpr std::chrono::milliseconds kStartedIsRead{50};

// A connection without a Connect request would occupy the only slot.
constexpr std::chrono::seconds kHandshake{2};

// For torques that answer the state before the last, in real time.
constexpr std::chrono::microseconds kGrace{300};

// Number of states between two that are skipped for a lagging program.
constexpr std::uint64_t kLeaveOutEvery = 100;

// Longest time that a program whose motion has ended waits for the world to advance.
constexpr std::chrono::milliseconds kPartingPatience{5};

// Bounds a flood of messages: the rest waits for the next round, so that no program blocks the loop.
constexpr int kDatagramsPerRound = 64, kConnectionsPerRound = 8;

bool is_external(const RobotState& state) {
  return state.controller_mode == static_cast<std::uint8_t>(ControllerMode::external);
}

bool is_finish(const RobotCommand& command) {
  return command.motion_generation_finished || command.torque_command_finished;
}

// Up to protocol version 9 a program that sends torques alone requests joint velocities, and sends zeros.
bool has_torques_alone(const MotionRequest& motion, const RobotCommand& command) {
  return motion.controller == ArmController::external &&
         (motion.generator == MotionGenerator::none ||
          (motion.generator == MotionGenerator::joint_velocity &&
           std::all_of(command.dq_c.begin(), command.dq_c.end(), [](double v) { return v == 0; })));
}

}  // namespace

ArmPort::ArmPort(ArmPortConfig config, SimulatedArm& arm)
    : config_(std::move(config)), arm_(arm), out_(config_.seed), in_(config_.seed ^ 0x9E3779B97F4A7C15u) {
  if (arm.joint_count() != kWireJoints) {
    throw std::invalid_argument("arm '" + config_.name + "' has " + std::to_string(arm.joint_count()) +
                                " joints; the control interface supports " + std::to_string(kWireJoints));
  }
  if (has_prismatic_joints(arm.model())) {
    throw std::invalid_argument(
        "arm '" + config_.name +
        "' has a prismatic joint; the control interface supports revolute joints only");
  }
  motions_ended_ = arm.motions_ended();
}

ArmPort::~ArmPort() {
  drop_client();
  if (listener_) poll_->remove(listener_.file());
}

void ArmPort::open(Poll& poll) {
  poll_ = &poll;
  listener_ = listen_on(config_.address, config_.port, "arm '" + config_.name + "'");
  config_.port = port_of(listener_);
  poll.add(listener_.file(), EPOLLIN, *this);
}

void ArmPort::ready(int file, std::uint32_t events) {
  if (file == listener_.file()) return accept();
  if (!client_) return;
  if (file == client_->udp.file()) return receive(host_now());
  if (file != client_->stream.file()) return;
  if ((events & EPOLLOUT) != 0) client_->stream.flush();
  if ((events & ~static_cast<std::uint32_t>(EPOLLOUT)) != 0) read_requests();
}

void ArmPort::accept() {
  for (int i = 0; i < kConnectionsPerRound; ++i) {
    auto accepted = accept_from(listener_);
    if (!accepted) return;
    // A disconnect and a new connection may arrive in the same round.
    if (client_ && client_->stream.peer_has_closed()) drop_client();
    if (client_ || frozen_ > 0) {
      counts_.refused.add();
      continue;
    }
    reader_.reset();
    client_ = std::make_unique<Client>(std::move(*accepted), *poll_, *this);
  }
}

void ArmPort::drop_client() {
  if (!client_) return;
  if (client_->watches_udp) poll_->remove(client_->udp.file());
  client_.reset();
  out_.clear();
  in_.clear();
  overtaken_.reset();
  stops_.count = recoveries_.count = 0;
  has_pending_ = answered_ = false;
  // No program commands the arm any longer.
  arm_.stop_motion();
  motions_ended_ = arm_.motions_ended();
  motion_ = {};
}

// --- UDP ---

// In real time datagrams are read once per period. They wake the loop only while it waits for them, or if
// their arrival time counts.
void ArmPort::watch_datagrams() {
  if (!client_ || !client_->udp) return;
  const bool required = frozen_ == 0 && (config_.lockstep || !in_.is_clear());
  if (required == client_->watches_udp) return;
  client_->watches_udp = required;
  if (required) {
    poll_->add(client_->udp.file(), EPOLLIN, *this);
  } else {
    poll_->remove(client_->udp.file());
  }
}

void ArmPort::receive(HostTime now) {
  if (!client_ || !client_->udp || frozen_ > 0) return;
  std::array<std::byte, kMaxCommandSize + 1> datagram;  // one byte more, to detect messages that are too long
  for (int i = 0; i < kDatagramsPerRound; ++i) {
    std::int64_t arrived_ns = 0;
    const auto size = receive_stamped(client_->udp, datagram, config_.lockstep ? nullptr : &arrived_ns);
    if (size < 0) break;  // none left; or an error because the program's socket is closed
    const std::span<const std::byte> bytes(datagram.data(), static_cast<std::size_t>(size));
    if (config_.lockstep || in_.is_clear()) {
      take_datagram(bytes, std::chrono::nanoseconds(arrived_ns == 0 ? 0 : arrived_ns - published_ns_));
      if (config_.lockstep && answered_) break;  // later datagrams are for the next round
    } else if (!in_.put(bytes, now)) {
      counts_.commands_lost.add();
    }
  }
  if (config_.lockstep) return;
  if (!in_.is_clear()) {
    in_.deliver(now, [this, now](auto bytes) { take_datagram(bytes, now - published_at_); });
  }
  if (!out_.is_clear()) out_.deliver(now, [this](auto bytes) { send_state(bytes); });
}

void ArmPort::take_datagram(std::span<const std::byte> datagram, std::chrono::nanoseconds after) {
  counts_.commands_received.add();
  if (decode(*client_->dialect, datagram, received_) != WireResult::ok ||
      received_.message_id > message_id_) {
    counts_.bad_datagrams.add();
    return;
  }
  // Commands of an earlier motion are ignored: programs repeat the last one until its effect is visible.
  const std::uint64_t id = received_.message_id;
  if (!motion_.runs || id < motion_.first_state) return;
  if (!motion_.asynchronous && motion_.commanded) {
    if (id <= newest_command_) return;  // a duplicate
    // In real time the period of a late set-point has been extrapolated: taken now, it would step back.
    const auto in_grace = [&] {
      return after <= kGrace && (config_.lockstep || has_torques_alone(arm_.motion(), received_));
    };
    const bool late = config_.strict ? id < message_id_ || after > kAnswerTime
                                     : id + 1 < message_id_ || (id < message_id_ && !in_grace());
    if (late) {
      counts_.commands_late.add();
      lagging_ = lagging_ || id == latest_late_ + 1;
      latest_late_ = id;
      return;
    }
  }
  newest_command_ = id;
  silent_ = false;
  const bool stale = id < message_id_ && !motion_.asynchronous;
  if (answer_fate_ != AnswerFate::arrives) {
    answered_ = !stale;
    (answer_fate_ == AnswerFate::lost ? counts_.commands_lost : counts_.commands_late).add();
    return;
  }
  if (stale && !has_pending_) stale_since_ = host_now();
  if (!stale) lagging_ = false;
  // Accept a program that keeps lagging: waiting for the newer answer would only slow it down.
  answered_ = !stale || lagging_;
  motion_.commanded = true;
  // An answer to an older state, replaced by the program's next answer in the same period: the torque
  // changed twice.
  if (has_pending_ && config_.lockstep) {
    fill(command_, pending_);
    arm_.count_replaced(command_);
  }
  pending_ = received_;
  has_pending_ = true;
  if (is_finish(pending_)) answered_at_ = host_now();
}

void ArmPort::command() {
  if (motion_.runs) {
    if (has_pending_) {
      fill(command_, pending_);
      arm_.take_command(command_);
      counts_.commands_used.add();
      lagging_ = !answered_;
    } else if (motion_.commanded && !parted_early_) {
      arm_.miss_command();
      if (!motion_.asynchronous) counts_.commands_missed.add();
      silent_ = awaits() == Awaits::command;
    }
    if (config_.own_clock) arm_.publish_desired();  // the world may not advance before the next state is sent
  }
  has_pending_ = answered_ = false;
}

void ArmPort::stepped(std::int64_t period) {
  message_id_ = static_cast<std::uint64_t>(period) + 1;
  published_at_ = host_now();
  if (!config_.lockstep) published_ns_ = stamp_clock_ns();
  notice_end();
  state_due_ = parted_early_ = false;
  if (frozen_ > 0) {
    if (--frozen_ > 0) return;
    if (client_) client_->stream.watch(true);
    watch_datagrams();
  }
  if (motion_.runs && message_id_ == motion_.first_state) motion_.shown = published_at_;
  publish();
  answer_waiting();
}

void ArmPort::publish() {
  answer_fate_ = AnswerFate::arrives;
  state_lost_ = false;
  if (!client_ || client_->dialect == nullptr) return;
  // A program that drives two arms from one thread may be one state behind with this arm and would stay
  // there, because an older state is always waiting. Skipping one state synchronizes it again.
  if (!config_.strict && lagging_ && motion_.runs && message_id_ > left_out_ + kLeaveOutEvery) {
    left_out_ = message_id_;
    return;
  }
  fill(state_, message_id_, arm_, config_.fixed);
  if (motion_.runs && is_external(state_)) {
    // A motion begins at zero, although the motors hold the arm until the first command is taken. After that,
    // the arm reports the torque that it just took, although the world has not yet advanced with it.
    if (!motion_.commanded) {
      show_torque_taken(state_, joint_constant(kWireJoints, 0));
    } else if (config_.own_clock) {
      show_torque_taken(state_, command_.tau_J_d);
    }
  }
  const std::size_t size = encode(*client_->dialect, state_, state_bytes_);
  const std::span<const std::byte> bytes(state_bytes_.data(), size);
  if (config_.lockstep && (out_.faults().any() || overtaken_)) {
    publish_with_fates(bytes);
  } else if (config_.lockstep || out_.is_clear()) {
    send_state(bytes);
    if (!config_.lockstep)
      published_ns_ = stamp_clock_ns();  // a stall before it is not charged to the
                                         // program
  } else {
    if (!out_.put(bytes, published_at_)) counts_.states_lost.add();
    out_.deliver(published_at_, [this](auto due) { send_state(due); });
  }
}

// Lock-step has no wall clock: latency is counted in periods. Because the world waits for every answer, it is
// known which answers would have been in time.
void ArmPort::publish_with_fates(std::span<const std::byte> bytes) {
  const FaultyLine::Fate way_out = out_.draw(), way_in = in_.draw();
  const auto overtaken = std::exchange(overtaken_, std::nullopt);
  if (way_out.lost) {
    state_lost_ = true;
    counts_.states_lost.add();
  } else if (way_out.overtaken) {
    state_lost_ = true;  // for this period
    std::copy(bytes.begin(), bytes.end(), overtaken_bytes_.begin());
    overtaken_ = bytes.size();
  } else {
    send_state(bytes);
    if (way_out.duplicated) send_state(bytes);
  }
  // The delayed state follows its successor; if that one is delayed too, both keep their order.
  if (overtaken && !overtaken_) send_state({overtaken_bytes_.data(), *overtaken});
  if (way_in.lost) {
    answer_fate_ = AnswerFate::lost;
  } else if (way_in.overtaken || way_out.delay + way_in.delay >= kArmPeriodNs) {
    answer_fate_ = AnswerFate::late;
  }
}

void ArmPort::send_state(std::span<const std::byte> datagram) {
  if (::send(client_->udp.file(), datagram.data(), datagram.size(), 0) >= 0) {
    counts_.states_sent.add();
  } else {
    counts_.states_lost.add();  // no room, or the program's socket is closed
  }
}

// --- waiting ---

ArmPort::Awaits ArmPort::awaits() const {
  if (!client_ || !motion_.runs || motion_.asynchronous || frozen_ > 0) return Awaits::nothing;
  if (message_id_ < motion_.first_state) return Awaits::nothing;
  if (answered_ || state_lost_) return Awaits::answered;
  return motion_.commanded ? Awaits::command : Awaits::first_command;
}

bool ArmPort::may_begin() const { return client_ && client_->dialect != nullptr && !motion_.runs; }

void ArmPort::mark_state_due() {
  if (!state_due_) state_due_since_ = host_now();
  state_due_ = true;
}

std::optional<HostTime> ArmPort::next_due() const {
  if (config_.lockstep) return std::nullopt;
  const auto out = out_.next_due(), in = in_.next_due();
  return out && in ? std::min(*out, *in) : out ? out : in;
}

// Sends the second reply of the Move whose motion has ended.
void ArmPort::notice_end() {
  const auto ended = arm_.motions_ended();
  if (ended == motions_ended_) return;
  motions_ended_ = ended;
  if (!motion_.runs) return;
  motion_.runs = false;
  motion_.end = status_of(arm_.motion_end());
  mark_state_due();
}

void ArmPort::answer_waiting() {
  if (!client_) return;
  tell_end(published_at_);
  for (std::size_t i = 0; i < stops_.count; ++i) reply(Command::stop_move, stops_.ids[i], Status::success);
  stops_.count = 0;
  if (recoveries_.count == 0 || arm_.mode() == ArmMode::recovering) return;
  const bool idle = arm_.mode() == ArmMode::idle;
  for (std::size_t i = 0; i < recoveries_.count; ++i) {
    reply(Command::automatic_error_recovery, recoveries_.ids[i], idle ? Status::success : Status::aborted);
  }
  recoveries_.count = 0;
}

void ArmPort::tell_end(HostTime now) {
  if (!motion_.end) return;
  if (!motion_.commanded && !motion_.stop_requested && now - motion_.started < kStartedIsRead) return;
  reply(Command::move, motion_.command_id, *motion_.end);
  motion_.end.reset();
}

// In lock-step the end of a motion is visible when the world advances, which may need another arm's command.
// A single-threaded program that drives both arms would wait forever: while it waits for this arm's end, it
// sends no command to the other. So the end is published early: with the number of the next state, the
// present measurements and the new mode.
void ArmPort::part_early(HostTime now) {
  const auto due = tend_due();
  if (!due || now < *due) return;
  if (has_pending_) {
    fill(command_, pending_);
    arm_.take_command(command_);
    counts_.commands_used.add();
    has_pending_ = false;
    notice_end();
  }
  parted_early_ = true;
  if (motion_.runs || client_->dialect == nullptr) return;
  fill(state_, message_id_ + 1, arm_, config_.fixed);
  show_idle(state_, arm_);
  send_state({state_bytes_.data(), encode(*client_->dialect, state_, state_bytes_)});
  answer_waiting();
}

std::optional<HostTime> ArmPort::tend_due() const {
  if (!config_.lockstep || !client_ || parted_early_ || frozen_ > 0) return std::nullopt;
  if (motion_.runs && has_pending_ && is_finish(pending_)) return answered_at_ + kPartingPatience;
  if (!motion_.runs && motion_.end) return state_due_since_ + kPartingPatience;
  return std::nullopt;
}

void ArmPort::tend(HostTime now) {
  notice_end();
  if (!client_ || frozen_ > 0) return;
  part_early(now);
  tell_end(now);
  if (reader_.waiting() > 0) serve_waiting();
  if (!client_) return;
  const bool unknown = client_->dialect == nullptr && now - client_->since > kHandshake;
  if (unknown || client_->stream.broken() || (client_->closing && client_->stream.all_sent())) drop_client();
}

// --- injection ---

void ArmPort::set_faults(const DatagramFaults& faults) {
  out_.set(faults);
  in_.set(faults);
  watch_datagrams();
}

void ArmPort::freeze(std::int64_t periods) {
  if (periods <= 0) return;
  frozen_ = periods;
  if (client_) client_->stream.watch(false);
  watch_datagrams();
}

void ArmPort::close_connection() { drop_client(); }

PortStatistics ArmPort::statistics() const {
  const auto& c = counts_;
  return {.clients = c.clients.get(),
          .refused = c.refused.get(),
          .motions = c.motions.get(),
          .states_sent = c.states_sent.get(),
          .states_lost = c.states_lost.get(),
          .commands_received = c.commands_received.get(),
          .commands_used = c.commands_used.get(),
          .commands_late = c.commands_late.get(),
          .commands_lost = c.commands_lost.get(),
          .commands_missed = c.commands_missed.get(),
          .bad_datagrams = c.bad_datagrams.get(),
          .bad_requests = c.bad_requests.get()};
}

}  // namespace multipanda::fci
