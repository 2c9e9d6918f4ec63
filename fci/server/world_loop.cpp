#include <algorithm>
#include <limits>

#include "core/types/time.hpp"
#include "fci/server/virtual_arms.hpp"

// The loop of the virtual arms: advancing the world, and the work of a period.
namespace multipanda::fci {
namespace {

using std::chrono::nanoseconds;

// Real time: after a late period, shorter ones follow until the wall clock is reached, but a program always
// has at least this time to answer. A longer delay is skipped.
constexpr nanoseconds kShortestPeriod{700'000};
constexpr nanoseconds kMostBehind{100'000'000};

// Lock-step: an active program answers within microseconds, as fast as sleeping would take. After this time
// the loop sleeps.
constexpr nanoseconds kSpin{60'000};
constexpr int kRoundsPerPoll = 32;  // interval at which the spinning loop polls for requests

// Shorter timeout for a program that has not answered before.
constexpr nanoseconds kSilentPatience{20'000'000};

constexpr HostTime kNever{std::numeric_limits<std::int64_t>::max()};

// The newer answer may follow an answer to the state before the last.
constexpr nanoseconds kStalePatience{20'000'000};

// While the world is paused, motions that start together start in the same period.
constexpr nanoseconds kTogether{20'000'000};

}  // namespace

void VirtualArms::run() {
  stepped_at_ = host_now();
  view_.publish(static_cast<std::uint64_t>(plant_.periods()) + 1, plant_);
  if (options_.on_period) options_.on_period(plant_);
  if (has_own_clocks()) {
    run_own_clocks();
  } else if (options_.pace == WorldPace::realtime) {
    run_realtime();
  } else {
    run_lockstep();
  }
  failed_ = plant_.failed();
  for (auto& port : ports_) port->close_connection();
  for (const auto* ports : {&grippers_, &vacuums_}) {
    for (const auto& port : *ports) {
      if (port) port->close_connection();
    }
  }
  requests_.close();
  running_ = false;
}

// One period of the world, with the commands that the ports have received.
void VirtualArms::step() {
  take_words();
  word_happened_ = false;
  // A scene's timeline starts with the first command of any arm.
  for (const auto& port : ports_) {
    if (port->has_command()) plant_.begin_timeline();
  }
  for (auto& port : ports_) port->command();
  advance_world();
  for (ArmIndex i = 0; i < ports_.size(); ++i) send_state(i, plant_.periods());
}

void VirtualArms::send_state(ArmIndex arm, std::int64_t count) {
  view_.note_sent(arm, static_cast<std::uint64_t>(count) + 1);
  ports_[arm]->stepped(count);
}

// The world, and its motion without commands to arms.
void VirtualArms::advance_world() {
  if (pushing_) apply_pushes();
  plant_.advance();
  const std::int64_t period = plant_.periods();
  view_.publish(static_cast<std::uint64_t>(period) + 1, plant_);
  if (options_.on_period) options_.on_period(plant_);
  for (const auto* ports : {&grippers_, &vacuums_}) {
    for (const auto& port : *ports) {
      if (port) port->stepped(period);
    }
  }
  periods_.add();
}

void VirtualArms::tend(HostTime now) {
  for (auto& port : ports_) port->tend(now);
}

// --- real time ---

void VirtualArms::run_realtime() {
  HostTime grid = host_now() + kArmPeriodNs, release = grid;
  while (!ending_ && !plant_.failed()) {
    HostTime wake = release;
    for (const auto& port : ports_) {
      if (const auto due = port->next_due()) wake = std::min(wake, *due);
    }
    timer_.ensure(wake);
    poll_.serve(-1);
    take_words();
    const HostTime now = host_now();
    if (now < release) {
      for (auto& port : ports_) {
        if (port->next_due()) port->receive(now);
      }
      continue;
    }
    for (auto& port : ports_) port->receive(now);
    step();
    tend(now);
    grid = grid + kArmPeriodNs;
    if (now - grid > kMostBehind) {
      const auto given_up = (now - grid) / kArmPeriodNs;
      overruns_.add(static_cast<std::uint64_t>(given_up));
      grid = grid + given_up * kArmPeriodNs;
    }
    release = std::max(grid, now + kShortestPeriod);
  }
}

// --- real time, each arm by its own clock ---

bool VirtualArms::has_own_clocks() const {
  return options_.pace == WorldPace::realtime && (options_.strict || !options_.clocks.empty());
}

// The world advances every millisecond with the torques that the arms have; an arm takes its command and
// sends its newest measurements at its own instants. Where both fall together the world goes first.
void VirtualArms::run_own_clocks() {
  const HostTime begin = host_now() + kArmPeriodNs;
  ArmClock world({}, begin);
  std::vector<ArmClock> clocks;
  for (ArmIndex i = 0; i < ports_.size(); ++i) {
    clocks.emplace_back(i < options_.clocks.size() ? options_.clocks[i] : ClockOffset{}, begin);
  }
  std::vector<std::int64_t> sent(ports_.size(), 0);
  while (!ending_ && !plant_.failed()) {
    HostTime wake = world.due();
    for (ArmIndex i = 0; i < ports_.size(); ++i) {
      wake = std::min(wake, clocks[i].due());
      if (const auto due = ports_[i]->next_due()) wake = std::min(wake, *due);
    }
    timer_.ensure(wake);
    poll_.serve(-1);
    take_words();
    if (const HostTime now = host_now(); now >= world.due()) {
      advance_world();
      world.sent(now);
      overruns_.set(world.set_back_ns() / static_cast<std::uint64_t>(kArmPeriodNs.count()));
    }
    for (ArmIndex i = 0; i < ports_.size(); ++i) {
      ArmPort& port = *ports_[i];
      const HostTime now = host_now();
      const bool due = now >= clocks[i].due();
      if (due || port.next_due()) port.receive(now);
      if (!due) continue;
      if (port.has_command()) plant_.begin_timeline();
      port.command();
      send_state(i, ++sent[i]);
      clocks[i].sent(host_now());
      port.tend(host_now());
    }
  }
}

// --- lock-step ---

void VirtualArms::run_lockstep() {
  constexpr int kMostTrust = 8;
  int rounds = 0, trust = kMostTrust;  // how often programs recently answered at once
  HostTime spin_until = host_now();
  while (!ending_ && !plant_.failed()) {
    if (++rounds >= kRoundsPerPoll) {
      rounds = 0;
      poll_.serve(0);
      take_words();
      tend(host_now());
    }
    const HostTime now = host_now();
    bool awaits = false;
    for (auto& port : ports_) {
      if (!port->awaits_datagram()) continue;
      port->receive(now);
      awaits = true;
    }
    const HostTime due = step_due();
    if (due <= now) {
      if (now < spin_until && trust < kMostTrust) ++trust;
      // A world that follows the wall clock catches up after a delay.
      const bool idle = due == stepped_at_ + kArmPeriodNs;
      step();
      const HostTime stepped = host_now();
      stepped_at_ = idle ? std::max(due, stepped + -kMostBehind) : stepped;
      spin_until = stepped;
      if (trust > 0 || periods_.get() % 64 == 0) spin_until = spin_until + kSpin;
      continue;
    }
    if (awaits && now < spin_until) continue;
    if (awaits && trust > 0) --trust;
    // Sleep until something arrives or the world has to advance.
    HostTime wake = due;
    for (const auto& port : ports_) wake = std::min(wake, port->tend_due().value_or(kNever));
    if (wake != kNever) timer_.ensure(wake);
    poll_.serve(-1);
    take_words();
    tend(host_now());
    rounds = 0;
  }
}

// Grippers finish motions independently of the arms.
bool VirtualArms::grippers_move() const {
  for (ArmIndex i = 0; i < plant_.arm_count(); ++i) {
    if (plant_.gripper_state(i).moving) return true;
  }
  return false;
}

// Latest time for advancing the world.
HostTime VirtualArms::step_due() const {
  bool moves = false, happened = word_happened_, others_may_join = false, recovers = false;
  HostTime happened_at = word_at_, hesitant_until{0}, silent_until{0};
  for (const auto& port : ports_) {
    if (port->state_due()) {
      happened_at = happened ? std::min(happened_at, port->state_due_since()) : port->state_due_since();
      happened = true;
    }
    others_may_join = others_may_join || port->may_begin();
    recovers = recovers || port->is_recovering();
    switch (port->awaits()) {
      case ArmPort::Awaits::nothing:
        break;
      case ArmPort::Awaits::answered:
        moves = true;
        break;
      case ArmPort::Awaits::command: {
        const nanoseconds patience = port->is_silent() ? kSilentPatience : nanoseconds(options_.patience);
        silent_until = std::max(silent_until, port->has_stale_answer() ? port->stale_since() + kStalePatience
                                                                       : port->published_at() + patience);
        moves = true;
        break;
      }
      case ArmPort::Awaits::first_command:
        // libfranka reads at least one more state before it sends a command.
        if (options_.idle_stands_still) {
          hesitant_until = std::max(hesitant_until, port->motion_shown_at() + kFirstPatience);
        }
        break;
    }
  }
  HostTime due = kNever;
  if (happened) {
    due = options_.idle_stands_still && others_may_join && !moves ? happened_at + kTogether : happened_at;
  } else if (moves) {
    due = hesitant_until;
  } else if (!options_.idle_stands_still || hesitant_until.ns > 0 || grippers_move() || recovers) {
    due = std::max(hesitant_until, stepped_at_ + kArmPeriodNs);
  }
  return std::max(due, silent_until);
}

// --- commands from other threads ---

void VirtualArms::take_words() {
  while (const Control* control = controls_.front()) {
    carry_out(*control);
    controls_.pop();
  }
  while (const auto* posted = requests_.front()) {
    requests_.answer(apply(*posted));
    something_happened();
  }
}

void VirtualArms::something_happened() {
  if (!word_happened_) word_at_ = host_now();
  word_happened_ = true;
}

ArmReply VirtualArms::apply(const RequestBox::Posted& posted) {
  const auto* of_world = std::get_if<WorldRequest>(&posted.request);
  if (of_world == nullptr) return plant_.arm(posted.arm).apply(std::get<ArmRequest>(posted.request));
  if (const auto* place = std::get_if<PlaceObject>(of_world)) {
    return plant_.place(posted.object, place->X_WO) ? ArmReply::done : ArmReply::would_penetrate;
  }
  if (const auto* push = std::get_if<PushObject>(of_world)) {
    plant_.push(posted.object, push->f_W, push->duration);
    return ArmReply::done;
  }
  if (!std::holds_alternative<ResetSimulation>(*of_world)) return ArmReply::not_supported;
  plant_.reset();
  return ArmReply::done;
}

void VirtualArms::carry_out(const Control& control) {
  ArmPort& port = *ports_[control.arm];
  SimulatedArm& arm = plant_.arm(control.arm);
  switch (control.what) {
    case Control::What::faults:
      port.set_faults(control.faults);
      return;
    case Control::What::guiding:
      arm.press_guiding(control.on);
      break;
    case Control::What::raise:
      arm.raise(control.error);
      break;
    case Control::What::freeze:
      port.freeze(control.periods);
      return;
    case Control::What::close:
      port.close_connection();
      break;
    case Control::What::push:
    case Control::What::lead:
      pushes_[control.arm] = {.f_W = control.force,
                              .periods = control.periods,
                              .leads = control.what == Control::What::lead,
                              .R_WE = plant_.world().X_WF(control.arm).rotation *
                                      plant_.arm(control.arm).settings().frames.X_FE.rotation};
      pushing_ = true;
      break;
  }
  something_happened();
}

// A slow hand: 600 N/m on about 5 kg, damped to at most 10/160 m/s. It also keeps the orientation, with at
// most 8 N m.
Wrench VirtualArms::led_wrench(ArmIndex arm, const Push& hand) const {
  constexpr double kStiffness = 600, kDamping = 160, kMost = 10;
  constexpr double kTwist = 10, kTurning = 1.5, kMostMoment = 8;
  const World& world = plant_.world();
  const Pose X_WF = world.X_WF(arm);
  const Pose X_WE = X_WF * plant_.arm(arm).settings().frames.X_FE;
  mjtNum velocity[6];  // angular first, at the body's origin
  const int body = world.arm(arm).last_link;
  mj_objectVelocity(world.model(), world.data(), mjOBJ_XBODY, body, velocity, 0);
  const Eigen::Map<const Vector3> w(velocity), v(velocity + 3), p_WL(world.data()->xpos + 3 * body);
  const Vector3 v_E = v + w.cross(X_WE.position - p_WL);
  Wrench F_E_W;
  const Vector6 off = pose_error({hand.R_WE, hand.f_W}, X_WE);
  F_E_W.force() = kStiffness * off.head<3>();
  F_E_W.torque() = kTwist * off.tail<3>();
  if (const double force = F_E_W.force().norm(); force > kMost) F_E_W.force() *= kMost / force;
  if (const double moment = F_E_W.torque().norm(); moment > kMostMoment)
    F_E_W.torque() *= kMostMoment / moment;
  F_E_W.force() -= kDamping * v_E;
  F_E_W.torque() -= kTurning * w;
  return shifted(F_E_W, X_WE.position - X_WF.position);
}

// A force on the flange. MuJoCo expects force and moment at the body's center of mass.
void VirtualArms::apply_pushes() {
  pushing_ = false;
  World& world = plant_.world();
  for (ArmIndex i = 0; i < pushes_.size(); ++i) {
    Push& push = pushes_[i];
    if (push.periods < 0) continue;
    const int body = world.arm(i).last_link;
    mjtNum* wrench = world.data()->xfrc_applied + 6 * body;
    const Eigen::Map<const Vector3> p_WC(world.data()->xipos + 3 * body);
    Wrench F_F_W;  // about the flange
    if (push.periods > 0 && push.leads) F_F_W = led_wrench(i, push);
    if (push.periods > 0 && !push.leads) F_F_W.force() = push.f_W;
    Eigen::Map<Vector6>{wrench} = shifted(F_F_W, world.X_WF(i).position - p_WC).vector;
    --push.periods;  // a last time with zero, to end it
    pushing_ = true;
  }
}

}  // namespace multipanda::fci
