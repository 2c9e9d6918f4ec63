#include "fci/simulated_time/simulated_time.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "core/model/prismatic_joints.hpp"
#include "fci/client/fci_backend.hpp"
#include "fci/client/state_intake.hpp"
#include "fci/server/wire.hpp"
#include "fci/simulated_time/implementation.hpp"

// Construction, the program's wake-ups, and the contract of a Backend.
namespace multipanda::fci {
namespace {

constexpr std::int64_t kMillisecond = 1'000'000;

ArmTiming drawn(Draw& draw) {
  return {.phase_ns = static_cast<std::int64_t>(draw.below(kMillisecond)),
          .drift_ppm = draw.between(-50, 50),
          .first_number = 1 + draw.below(1'000'000),
          .to_client = {},
          .to_arm = {}};
}

void check(const ArmTiming& timing, const std::string& name) {
  if (timing.phase_ns < 0 || timing.phase_ns > kMillisecond || !(std::abs(timing.drift_ppm) <= 1e4) ||
      timing.first_number == 0) {
    throw std::invalid_argument("the clock of arm '" + name +
                                "': expected a phase of 0 to 1 ms, a drift of up to 10000 ppm, and a first "
                                "number of 1 or more");
  }
  for (const LinkTiming* link : {&timing.to_client, &timing.to_arm}) {
    if (link->delay.least_ns < 0 || link->delay.spread_ns < 0 || !(link->loss >= 0 && link->loss <= 1)) {
      throw std::invalid_argument("the network of arm '" + name +
                                  "': expected delays of 0 or more, and a loss of 0 to 1");
    }
  }
}

}  // namespace

SimulatedTime::Implementation::Implementation(const Scene& scene, SimulatedTimeOptions requested)
    : options(std::move(requested)),
      plant(scene, {.timeline_waits = true}),
      draw_network(options.seed),
      draw_client(options.seed ^ 0x9E3779B97F4A7C15u) {
  if (options.arms.size() > scene.arms.size()) throw std::invalid_argument("more clocks than arms");
  Draw draw(options.seed ^ 0xD1B54A32D192ED03u);
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    const SceneArm& of_scene = scene.arms[i];
    const ArmTiming own = drawn(draw);
    Arm& arm = arms.emplace_back();
    arm.name = of_scene.name;
    arm.timing = i < options.arms.size() ? options.arms[i] : own;
    check(arm.timing, arm.name);
    FciArmConfig config = fci_arm_config(of_scene, "simulated time");
    const FixedConfig fixed = fixed_config(of_scene);
    const int version = options.version != 0 ? options.version : fixed.versions.newest;
    const Dialect* dialect = fci::dialect(static_cast<std::uint16_t>(version));
    if (dialect == nullptr) {
      throw std::invalid_argument("version " + std::to_string(version) +
                                  " of the protocol: expected 4 to 10");
    }
    if (plant.arm(i).joint_count() != kWireJoints) {
      throw std::invalid_argument("arm '" + arm.name + "': the control interface needs seven joints");
    }
    if (has_prismatic_joints(plant.arm(i).model())) {
      throw std::invalid_argument("arm '" + arm.name + "': the control interface has no prismatic joints");
    }
    arm.side = std::make_unique<ArmSide>(plant.arm(i), fixed, *dialect, arm.timing.first_number,
                                         ArmSide::Rules{.late = options.late_answers,
                                                        .first_torque = options.first_torque,
                                                        .answer_ns = options.answer_ns});
    arm.client = std::make_unique<ClientSide>(config, *dialect, [this, i](auto bytes) {
      Arm& from = arms[i];
      ++from.side->counts().answers_sent;
      std::int64_t extra_ns = 0;
      if (from.answers_to_lose > 0) {
        --from.answers_to_lose;
        ++from.side->counts().answers_lost;
        return;
      }
      if (from.answers_to_delay > 0) {
        --from.answers_to_delay;
        extra_ns = from.delay_ns;
      }
      travel(i, true, bytes, std::max<std::int64_t>(0, sending_ns - events.now_ns()) + extra_ns);
    });
    // Settings sent by a program at its start that the simulated arm does not have already.
    if (config.thresholds) plant.arm(i).apply(*config.thresholds);
    events.at(kMillisecond + arm.timing.phase_ns, [this, i] { arm_period(i); });
  }
  events.at(kMillisecond, [this] { step_world(); });
}

// --- the program ---

ArmSet SimulatedTime::Implementation::unread() const {
  ArmSet set;
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    if (arms[i].client->is_unread()) set |= ArmSet::of(i);
  }
  return set;
}

// The duration of a part of the cycle.
std::int64_t SimulatedTime::Implementation::cost(Stall where) {
  const bool reading = where == Stall::before_reading;
  std::int64_t ns = draw_client.time(reading ? options.client.wake : options.client.compute);
  // Each of the two parts of a cycle has half of the stalls.
  const bool stalls = draw_client.happens(0.5e-3 * options.client.stalls_per_s);
  if (stalls) ns += draw_client.time(options.client.stall);
  return ns + std::exchange(reading ? stall_reading_ns : stall_sending_ns, 0);
}

// Waits for a state, or one of every arm; then for the program's wake-up time.
ArmSet SimulatedTime::Implementation::wait(std::int64_t deadline_ns, bool for_all) {
  events.run_until(busy_until_ns);
  const auto ready = [&] { return for_all ? unread() == ArmSet::all(arms.size()) : !unread().empty(); };
  bool slept = false;
  FirstStates states;
  while (!ready() && !plant.failed()) {
    slept = true;
    for (ArmIndex i = 0; for_all && i < arms.size(); ++i) {
      ClientSide& client = *arms[i].client;
      if (!client.is_unread() || !states.is_to_be_held(i, client.newest().message_id)) continue;
      sending_ns = events.now_ns() + draw_client.time(options.client.compute);
      client.hold(false);
    }
    if (events.next_ns() > deadline_ns) {
      events.run_until(deadline_ns);
      break;
    }
    events.step();
  }
  if (slept || stall_reading_ns > 0) events.run_until(events.now_ns() + cost(Stall::before_reading));
  woken_ns = events.now_ns();
  const ArmSet due = unread();
  for (ArmIndex i = 0; i < arms.size(); ++i) arms[i].client->mark_read();
  return due;
}

void SimulatedTime::Implementation::hold_all(bool last) {
  sending_ns = events.now_ns() + draw_client.time(options.client.compute);
  for (Arm& arm : arms) {
    if (!arm.client->is_unread()) continue;
    arm.client->mark_read();
    arm.client->hold(last);
  }
}

// Answers every state with the arm's hold while no loop runs.
bool SimulatedTime::Implementation::run_until(const std::function<bool()>& done, std::int64_t deadline_ns,
                                              bool last) {
  while (!done() && events.now_ns() < deadline_ns && !plant.failed()) {
    events.step();
    hold_all(last);
  }
  return done();
}

// --- Backend ---

SimulatedTime::SimulatedTime(const Scene& scene, SimulatedTimeOptions options)
    : self_(std::make_unique<Implementation>(scene, std::move(options))) {}
SimulatedTime::~SimulatedTime() = default;

std::size_t SimulatedTime::arm_count() const { return self_->arms.size(); }

Capabilities SimulatedTime::capabilities(ArmIndex) const {
  return {.simulated = true,
          .lockstep = false,
          .compensates_gravity = true,
          .compensates_friction = true,
          .has_external_torque = true,
          .has_contact_truth = false,
          .has_gripper = false,
          .has_vacuum = false,
          .every_command_arrives = false,
          .own_clock = true,
          .torque_low_pass_hz = 0,
          .torque_rate_max = kTorqueRateMax};
}

void SimulatedTime::start() {
  auto& self = *self_;
  std::vector<std::future<RequestAnswer>> begun;
  for (ArmIndex i = 0; i < self.arms.size(); ++i) {
    self.arms[i].client->connect();
    self.arms[i].client->enter(ArmPhase::preparing);
  }
  const auto begin = [&self](ArmIndex i) {
    Implementation::Arm& arm = self.arms[i];
    arm.client->enter(ArmPhase::stopped);
    arm.asking = true;
    arm.asked.push_back({RecoverFromError{}, {}});
    self.start_motion(i);
    return arm.asked.back().promise.get_future();
  };
  for (ArmIndex i = 0; i < self.arms.size(); ++i) begun.push_back(begin(i));
  const auto ready = [&begun] {
    return std::all_of(begun.begin(), begun.end(), [](auto& future) {
      return future.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    });
  };
  (void)self.run_until(ready, self.events.now_ns() + nanoseconds(2 * self.options.request_timeout_s), false);
  std::string why;
  for (ArmIndex i = 0; i < begun.size(); ++i) {
    if (begun[i].wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
      why += "arm " + self.arms[i].name + " did not begin; ";
    } else if (auto answer = begun[i].get(); !answer.success) {
      why += answer.reason + "; ";
    }
  }
  if (!why.empty()) throw std::runtime_error(why.substr(0, why.size() - 2));
  self.busy_until_ns = self.events.now_ns();
  self.running = self.first = true;
}

void SimulatedTime::finish() {
  auto& self = *self_;
  self.events.run_until(self.busy_until_ns);
  for (auto& arm : self.arms) arm.client->release_hold();
  const auto at_rest = [&self] {
    return std::none_of(self.arms.begin(), self.arms.end(), [](const auto& arm) { return arm.side->runs(); });
  };
  (void)self.run_until(at_rest, self.events.now_ns() + nanoseconds(0.5), true);
  for (ArmIndex i = 0; i < self.arms.size(); ++i) {
    self.arms[i].side->stop_motion();
    self.lose_connection(i);
  }
  self.running = false;
}

ArmSet SimulatedTime::wait() {
  auto& self = *self_;
  if (ended()) return {};
  constexpr double kFirst = 1.0;  // [s] for every arm's first state
  const std::int64_t from = std::max(self.events.now_ns(), self.busy_until_ns);
  const bool first = std::exchange(self.first, false);
  const ArmSet due = self.wait(from + nanoseconds(first ? kFirst : self.options.silence_s), first);
  if (first) self.begun_ns = self.woken_ns;
  self.now = {self.woken_ns - self.begun_ns};
  return due;
}

ArmSet SimulatedTime::wait_until(HostTime deadline) {
  auto& self = *self_;
  if (ended()) return {};
  const ArmSet due = self.wait(deadline.ns, false);
  if (std::exchange(self.first, false)) self.begun_ns = self.woken_ns;
  self.now = {self.woken_ns - self.begun_ns};
  return due;
}

bool SimulatedTime::ended() const { return !self_->running || self_->plant.failed(); }
LoopTime SimulatedTime::now() const { return self_->now; }
std::int64_t SimulatedTime::time_ns() const { return self_->events.now_ns(); }

void SimulatedTime::read(ArmSet due, std::span<ArmState> states) {
  auto& self = *self_;
  const double lost = self.options.lost_after_s;
  for (ArmIndex i = 0; i < self.arms.size(); ++i) {
    ClientSide& client = *self.arms[i].client;
    if (due.contains(i)) {
      client.fill(self.woken_ns, lost, states[i]);
    } else if (client.mode(self.woken_ns, lost) == ArmMode::disconnected) {
      states[i].mode = ArmMode::disconnected;
    }
  }
}

std::optional<Pose> SimulatedTime::object_pose(const std::string& name) const {
  return self_->plant.object_pose(name);
}

void SimulatedTime::write(ArmSet due, std::span<const ArmCommand> commands) {
  auto& self = *self_;
  self.sending_ns = self.busy_until_ns = self.woken_ns + self.cost(Stall::before_sending);
  for (ArmIndex i = 0; i < self.arms.size(); ++i) {
    if (!due.contains(i)) continue;
    if (!self.arms[i].client->command(commands[i].tau_cmd)) (void)request(i, StopMotion{});
  }
}

// --- faults ---

void SimulatedTime::lose_answers(ArmIndex arm, int count) { self_->arms.at(arm).answers_to_lose += count; }
void SimulatedTime::delay_answers(ArmIndex arm, int count, std::int64_t by_ns) {
  self_->arms.at(arm).answers_to_delay += count;
  self_->arms[arm].delay_ns = by_ns;
}
void SimulatedTime::lose_states(ArmIndex arm, int count) { self_->arms.at(arm).states_to_lose += count; }
void SimulatedTime::pull_cable(ArmIndex arm, bool pulled) { self_->arms.at(arm).cable_pulled = pulled; }
void SimulatedTime::raise(ArmIndex arm, ArmError error) { self_->plant.arm(arm).raise(error); }
void SimulatedTime::press_user_stop(ArmIndex arm, bool pressed) {
  self_->plant.arm(arm).apply(SetUserStop{pressed});
}
void SimulatedTime::press_guiding(ArmIndex arm, bool pressed) {
  self_->plant.arm(arm).press_guiding(pressed);
}
void SimulatedTime::push(ArmIndex arm, const Vector3& f_W, double duration_s) {
  auto& pushed = self_->arms.at(arm);
  pushed.push_W = f_W;
  pushed.push_until_ns = time_ns() + nanoseconds(duration_s);
}
void SimulatedTime::stall_client(std::int64_t ns, Stall where) {
  (where == Stall::before_reading ? self_->stall_reading_ns : self_->stall_sending_ns) += ns;
}
void SimulatedTime::lose_client() {
  for (ArmIndex i = 0; i < self_->arms.size(); ++i) {
    self_->lose_connection(i);
    // The arm notices the end of the connection.
    self_->events.after(self_->draw_network.time(self_->options.request),
                        [this, i] { self_->arms[i].side->stop_motion(); });
  }
}

void SimulatedTime::at(std::int64_t time_ns, std::function<void()> what) {
  self_->events.at(time_ns, std::move(what));
}

void SimulatedTime::every(std::int64_t period_ns, DrawnTime jitter, DrawnTime compute,
                          std::function<void(std::int64_t)> what) {
  if (period_ns <= 0) throw std::invalid_argument("a period must be positive");
  struct Caller {
    std::int64_t period_ns, grid_ns;
    DrawnTime jitter, compute;
    std::function<void(std::int64_t)> what;
  };
  auto caller = std::make_shared<Caller>(Caller{period_ns, time_ns(), jitter, compute, std::move(what)});
  struct Again {
    Implementation* self;
    std::shared_ptr<Caller> caller;
    void operator()() const {
      const std::int64_t now = self->events.now_ns();
      caller->what(now);
      const std::int64_t done = now + self->draw_client.time(caller->compute);
      do {
        caller->grid_ns += caller->period_ns;
      } while (caller->grid_ns < done);
      self->events.at(caller->grid_ns + self->draw_client.time(caller->jitter), *this);
    }
  };
  self_->events.at(time_ns(), Again{self_.get(), std::move(caller)});
}

const ArmCounts& SimulatedTime::counts(ArmIndex arm) const { return self_->arms.at(arm).side->counts(); }
const SimulatedArm& SimulatedTime::arm(ArmIndex i) const { return self_->plant.arm(i); }
MujocoPlant& SimulatedTime::plant() { return self_->plant; }

}  // namespace multipanda::fci
