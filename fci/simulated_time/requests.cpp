#include <cmath>
#include <utility>

#include "arm_interface/arm_settings.hpp"
#include "core/types/overloaded.hpp"
#include "fci/client/arm_mode.hpp"
#include "fci/simulated_time/implementation.hpp"

// Requests: the TCP communication of an arm's commander, as events.
namespace multipanda::fci {
namespace {

constexpr std::int64_t kRetry = 1'000'000;  // polling interval while waiting for a state [ns]

}  // namespace

std::future<RequestAnswer> SimulatedTime::request(ArmIndex i, ArmRequest request) {
  auto& self = *self_;
  if (i >= arm_count()) return refuse_request(no_such_arm(i, arm_count()));
  auto& arm = self.arms[i];
  if (auto why = check_request(request, arm.side->arm().model()); !why.empty())
    return refuse_request(std::move(why));
  if (std::holds_alternative<SetUserStop>(request)) {
    return refuse_request("a real arm does not support this request: it is for simulated arms");
  }
  arm.asked.push_back({std::move(request), {}});
  auto future = arm.asked.back().promise.get_future();
  if (!arm.asking) self.ask_next(i);
  return future;
}

void SimulatedTime::Implementation::answer(ArmIndex i, RequestAnswer answer) {
  Arm& arm = arms[i];
  ++arm.turn;
  arm.asking = false;
  if (!answer.success) answer.reason = arm.name + ": " + answer.reason;
  arm.asked.front().promise.set_value(std::move(answer));
  arm.asked.pop_front();
  if (!arm.asked.empty()) ask_next(i);
}

void SimulatedTime::Implementation::over_network(ArmIndex i, std::function<void()> what) {
  const std::uint64_t turn = arms[i].turn;
  const std::int64_t deadline = events.now_ns() + nanoseconds(options.request_timeout_s);
  struct Arrival {
    Implementation* self;
    ArmIndex i;
    std::uint64_t turn;
    std::int64_t deadline;
    std::function<void()> what;
    void operator()() const {
      Arm& arm = self->arms[i];
      if (arm.turn != turn) return;
      if (!arm.cable_pulled) return what();
      if (self->events.now_ns() >= deadline) {
        arm.client->enter(ArmPhase::offline);
        return self->answer(i, {false, "it does not answer"});
      }
      self->events.after(kRetry, *this);
    }
  };
  events.after(draw_network.time(options.request), Arrival{this, i, turn, deadline, std::move(what)});
}

void SimulatedTime::Implementation::ask_next(ArmIndex i) {
  Arm& arm = arms[i];
  arm.asking = true;
  const ArmRequest& request = arm.asked.front().request;
  const bool offline = arm.client->phase() == ArmPhase::offline;
  if (std::holds_alternative<Reconnect>(request)) {
    if (!offline) return answer(i, {false, "it is connected: there is nothing to reconnect"});
    over_network(i, [this, i] {
      arms[i].side->stop_motion();  // left by a program that has ended
      arms[i].client->connect();
      arms[i].client->enter(ArmPhase::stopped);
      start_motion(i);
    });
    return;
  }
  if (offline) return answer(i, {false, "it is not connected"});
  if (std::holds_alternative<RecoverFromError>(request)) return recover(i);
  if (std::holds_alternative<StopMotion>(request)) {
    over_network(i, [this, i] {
      arms[i].side->stop_motion();
      over_network(i, [this, i] {
        arms[i].client->enter(ArmPhase::stopped);
        answer(i, {true, {}});
      });
    });
    return;
  }
  change_setting(i);
}

void SimulatedTime::Implementation::recover(ArmIndex i) {
  ClientSide& client = *arms[i].client;
  const RobotState& state = client.newest();
  if (is_mode(state, RobotMode::move) && client.phase() == ArmPhase::running) {
    return answer(i, {false, "it has no error and was not stopped: there is nothing to recover from"});
  }
  if (is_mode(state, RobotMode::user_stopped) || is_mode(state, RobotMode::guiding) ||
      is_mode(state, RobotMode::other)) {
    return answer(i, {false, refusal_in_mode(arms[i].name, state)});
  }
  if (!is_mode(state, RobotMode::reflex)) return start_motion(i);
  client.enter(ArmPhase::starting);
  over_network(i, [this, i] {
    if (!arms[i].side->recover()) {
      arms[i].client->enter(ArmPhase::stopped);
      return answer(i, {false, "it refuses to recover"});
    }
    await_recovery(i);
  });
}

// The arm's reply follows the state that shows it at rest.
void SimulatedTime::Implementation::await_recovery(ArmIndex i) {
  events.after(2 * kRetry, [this, i, turn = arms[i].turn] {
    if (arms[i].turn != turn) return;
    if (arms[i].side->is_recovering()) return await_recovery(i);
    over_network(i, [this, i] { start_motion(i); });
  });
}

void SimulatedTime::Implementation::start_motion(ArmIndex i) {
  arms[i].client->enter(ArmPhase::starting);
  over_network(i, [this, i] {
    const bool started = arms[i].side->start_motion() == MotionStart::started;
    arms[i].ends_known = arms[i].side->motions_ended();
    over_network(i, [this, i, started] {
      if (started) return wait_for_start(i, events.now_ns() + nanoseconds(options.request_timeout_s));
      arms[i].client->enter(ArmPhase::stopped);
      answer(i, {false, "start a motion: " + refusal_in_mode(arms[i].name, arms[i].client->newest())});
    });
  });
}

void SimulatedTime::Implementation::wait_for_start(ArmIndex i, std::int64_t deadline_ns) {
  Arm& arm = arms[i];
  if (arm.client->newest().message_id != 0 && arm.client->is_running()) {
    arm.client->enter(ArmPhase::running);
    return answer(i, {true, {}});
  }
  if (events.now_ns() >= deadline_ns || !arm.side->runs()) {
    arm.client->enter(ArmPhase::stopped);
    return answer(i, {false, "its motion ended before it started"});
  }
  events.after(kRetry / 10, [this, i, deadline_ns, turn = arm.turn] {
    if (arms[i].turn == turn) wait_for_start(i, deadline_ns);
  });
}

// Arms accept settings only at rest: torque control is interrupted for them.
void SimulatedTime::Implementation::change_setting(ArmIndex i) {
  constexpr double kStill = 0.02;  // [rad/s]
  const RobotState& state = arms[i].client->newest();
  const bool moves = arms[i].client->phase() == ArmPhase::running;
  for (const double v : state.dq) {
    if (moves && std::abs(v) > kStill) return answer(i, {false, "it accepts this only at rest"});
  }
  if (moves) arms[i].client->enter(ArmPhase::starting);
  over_network(i, [this, i, moves] {
    if (moves) arms[i].side->stop_motion();
    const bool done = arms[i].side->apply(arms[i].asked.front().request);
    over_network(i, [this, i, moves, done] {
      if (moves && done) return start_motion(i);
      if (moves) arms[i].client->enter(ArmPhase::stopped);
      answer(i, {done, done ? "" : "it refuses this in its present mode"});
    });
  });
}

// The second reply to a Move: the motion has ended.
void SimulatedTime::Implementation::tell_end(ArmIndex i) {
  Arm& arm = arms[i];
  if (arm.ends_known == arm.side->motions_ended()) return;
  arm.ends_known = arm.side->motions_ended();
  if (arm.cable_pulled) return;
  events.after(draw_network.time(options.request), [this, i, told = arm.ends_known] {
    if (arms[i].ends_known == told && arms[i].client->phase() == ArmPhase::running) {
      arms[i].client->enter(ArmPhase::stopped);
    }
  });
}

void SimulatedTime::Implementation::lose_connection(ArmIndex i) {
  Arm& arm = arms[i];
  arm.client->enter(ArmPhase::offline);
  ++arm.turn;
  while (!arm.asked.empty()) {
    arm.asked.front().promise.set_value({false, arm.name + ": the connection was closed"});
    arm.asked.pop_front();
  }
  arm.asking = false;
}

}  // namespace multipanda::fci
