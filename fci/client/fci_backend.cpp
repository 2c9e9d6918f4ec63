#include "fci/client/fci_backend.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <poll.h>
#include <stdexcept>

#include "arm_interface/arm_settings.hpp"
#include "core/model/prismatic_joints.hpp"
#include "core/types/gap_watch.hpp"
#include "fci/client/arm_driver.hpp"
#include "fci/client/end_effector.hpp"
#include "fci/client/state_intake.hpp"
#include "scene/build.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

namespace {

FciOptions serialize_messages(FciOptions options) {
  if (!options.report) return options;
  options.report = [voice = std::make_shared<std::mutex>(),
                    say = std::move(options.report)](const std::string& text) {
    const std::lock_guard lock(*voice);
    say(text);
  };
  return options;
}

void check(const FciArmConfig& arm) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument("arm '" + arm.name + "': " + why);
  };
  if (arm.model == nullptr) refuse("the model is missing");
  if (arm.model->joint_count() != 7) {
    refuse("the control interface needs a model with seven joints, found " +
           std::to_string(arm.model->joint_count()));
  }
  if (has_prismatic_joints(*arm.model))
    refuse(
        "the control interface needs revolute joints, found a prismatic one; such an arm can be simulated");
  if (arm.address.empty()) refuse("the address is missing");
  if (!(arm.low_pass_hz >= 0) || arm.low_pass_hz > 1000)
    refuse("the low-pass cutoff must be 0 (none) to 1000 Hz");
  std::string why = check_request(SetFrames{arm.frames.X_FE, arm.frames.X_EK}, *arm.model);
  if (why.empty()) why = check_request(SetLoad{arm.load}, *arm.model);
  if (why.empty() && arm.joint_stiffness)
    why = check_request(SetJointStiffness{*arm.joint_stiffness}, *arm.model);
  if (why.empty() && arm.cartesian_stiffness) {
    why = check_request(SetCartesianStiffness{*arm.cartesian_stiffness}, *arm.model);
  }
  if (why.empty() && arm.thresholds) why = check_request(*arm.thresholds, *arm.model);
  if (!why.empty()) refuse(why);
}

}  // namespace

struct FciBackend::Implementation {
  explicit Implementation(std::vector<FciArmConfig> configs, FciOptions requested)
      : options(serialize_messages(std::move(requested))) {
    if (configs.empty() || configs.size() > kMaxArms) {
      throw std::invalid_argument("1 to " + std::to_string(kMaxArms) + " arms, not " +
                                  std::to_string(configs.size()));
    }
    for (const auto& config : configs) check(config);
    for (auto& config : configs) {
      sensors.emplace_back();
      if (config.force_sensor) {
        config.force_sensor->report = options.report;
        sensors.back() = std::make_unique<NetFt>(*config.force_sensor);
      }
      arms.push_back(std::make_unique<ArmDriver>(std::move(config), options));
      watched[arms.size() - 1] = {.fd = arms.back()->udp_file(), .events = POLLIN, .revents = 0};
    }
  }

  void receive_all() {
    for (const auto& arm : arms) arm->receive();
  }
  ArmSet unread() const {
    ArmSet set;
    for (ArmIndex i = 0; i < arms.size(); ++i) {
      if (arms[i]->is_unread()) set |= ArmSet::of(i);
    }
    return set;
  }
  // Sleeps until a datagram arrives or `deadline` has passed.
  void sleep_until(HostTime deadline) {
    const std::int64_t left = std::max<std::int64_t>(0, deadline.ns - host_now().ns);
    const timespec timeout{.tv_sec = left / 1'000'000'000, .tv_nsec = left % 1'000'000'000};
    (void)::ppoll(watched.data(), arms.size(), &timeout, nullptr);
  }
  ArmSet step_of_all(HostTime deadline);
  ArmSet all_once(HostTime deadline);
  ArmSet deliver(ArmSet due);
  void advance_time(ArmSet due);
  std::vector<RequestAnswer> wait_for(std::vector<std::future<RequestAnswer>> futures, bool beginning);
  void hold(HostTime since);
  [[noreturn]] void give_up(const std::vector<RequestAnswer>& answers);

  const FciOptions options;
  std::vector<std::unique_ptr<ArmDriver>> arms;
  std::vector<std::unique_ptr<NetFt>> sensors;  // of the arms; empty: none
  std::array<pollfd, kMaxArms> watched{};
  bool running = false;
  GapWatch gaps;          // of start()
  bool first = true;      // no wait() yet
  HostTime begun, woken;  // first wait(), last wait() [this computer's time]
  LoopTime now;
  std::uint64_t step_id = 0;  // lock-step: the arms' number for the current step
};

namespace {

HostTime later(HostTime t, double s) { return {t.ns + static_cast<std::int64_t>(std::llround(s * 1e9))}; }

}  // namespace

FciBackend::FciBackend(std::vector<FciArmConfig> arms, FciOptions options)
    : self_(std::make_unique<Implementation>(std::move(arms), std::move(options))) {}
FciBackend::~FciBackend() = default;

std::size_t FciBackend::arm_count() const { return self_->arms.size(); }
Capabilities FciBackend::capabilities(ArmIndex arm) const { return self_->arms[arm]->capabilities(); }
bool FciBackend::ended() const { return !self_->running; }
LoopTime FciBackend::now() const { return self_->now; }
std::optional<ConnectionStatistics> FciBackend::connection(ArmIndex arm) const {
  return self_->arms[arm]->statistics();
}
ArmIdentity FciBackend::identity(ArmIndex arm) const { return self_->arms[arm]->identity(); }

std::uint64_t FciBackend::overruns() const {
  std::uint64_t lost = 0;
  for (const auto& arm : self_->arms) lost += arm->statistics().lost;
  return lost;
}

std::future<RequestAnswer> FciBackend::request(ArmIndex arm, ArmRequest request) {
  if (arm >= arm_count()) return refuse_request(no_such_arm(arm, arm_count()));
  if (auto why = check_request(request, *self_->arms[arm]->config().model); !why.empty())
    return refuse_request(std::move(why));
  return self_->arms[arm]->request(std::move(request));
}

std::future<RequestAnswer> FciBackend::request(ArmIndex arm, GripperRequest request) {
  if (arm >= arm_count()) return refuse_request(no_such_arm(arm, arm_count()));
  return self_->arms[arm]->request(std::move(request));
}

// --- start and finish ---

// The loop's thread reads the arms' states while their commanders work. `beginning`: the arms start; one that
// does not move, or no longer, is not waited for without limit. One that is held as long as the others moves:
// only its commander is late.
std::vector<RequestAnswer> FciBackend::Implementation::wait_for(
    std::vector<std::future<RequestAnswer>> futures, bool beginning) {
  using std::chrono::seconds;
  std::vector<RequestAnswer> answers(futures.size());
  const auto is_ready = [&](std::size_t i) {
    return futures[i].wait_for(seconds(0)) == std::future_status::ready;
  };
  const HostTime since = host_now();
  for (std::size_t i = 0; i < futures.size();) {
    if (is_ready(i)) {
      answers[i] = futures[i].get();
      ++i;
      continue;
    }
    sleep_until(later(host_now(), 0.001));
    (void)gaps.look();
    receive_all();
    hold(since);
    if (!beginning || options.lockstep) continue;
    int held = 0;
    for (const auto& arm : arms) held = std::max(held, arm->held_packets());
    const auto is_late = [&](std::size_t k) {
      return !is_ready(k) && held - arms[k]->held_packets() > options.longest_wait_packets;
    };
    std::size_t late = i;
    while (late < arms.size() && !is_late(late)) ++late;
    if (late == arms.size()) continue;
    for (; i < futures.size(); ++i) {
      if (i != late && is_ready(i)) {
        answers[i] = futures[i].get();
      } else if (i == late || is_late(i)) {
        answers[i] = {false,
                      "arm " + arms[i]->config().name +
                          " did not begin its torque motion, or left it, while the others were held for " +
                          std::to_string(held) +
                          " packets: start again; if it recurs, look at the arm's page in Desk"};
      } else {
        answers[i] = {true, {}};
      }
    }
  }
  receive_all();
  return answers;
}

// Holds arms whose motion runs while others are still starting or ending. In lock-step their world waits,
// unless it has to advance for the others.
void FciBackend::Implementation::hold(HostTime since) {
  constexpr double kPatience = 0.1;  // [s]
  if (options.lockstep && seconds(host_now() - since) < kPatience) return;
  for (const auto& arm : arms) {
    if (!arm->is_unread()) continue;
    arm->mark_read();
    arm->hold(false);
  }
}

void FciBackend::Implementation::give_up(const std::vector<RequestAnswer>& answers) {
  std::vector<std::future<RequestAnswer>> leaving;
  for (const auto& arm : arms) leaving.push_back(arm->leave(false));
  (void)wait_for(std::move(leaving), false);
  std::string text;
  for (const RequestAnswer& answer : answers) {
    if (!answer.success) text += (text.empty() ? "" : "\n") + answer.reason;
  }
  throw std::runtime_error(text);
}

const ForceReading* FciBackend::force_reading(ArmIndex arm) {
  return self_->sensors[arm] ? &self_->sensors[arm]->latest() : nullptr;
}

void FciBackend::start() {
  auto& self = *self_;
  for (const auto& sensor : self.sensors) {
    if (sensor) sensor->start();
  }
  const auto on_all = [&self](auto&& what, bool beginning) {
    std::vector<std::future<RequestAnswer>> futures;
    for (const auto& arm : self.arms) futures.push_back(what(*arm));
    auto answers = self.wait_for(std::move(futures), beginning);
    // A run that begins minutes after somebody started it could move an arm that they have gone to.
    if (self.options.begin_torque && !self.options.lockstep && self.gaps.look() != HostTime{})
      answers.push_back(
          {false, "this program stalled while the arms were being started: look at them, then start again"});
    if (std::any_of(answers.begin(), answers.end(), [](const auto& a) { return !a.success; })) {
      self.give_up(answers);
    }
  };
  self.gaps = {};
  (void)self.gaps.look();
  on_all([](ArmDriver& arm) { return arm.prepare(); }, false);
  for (const auto& arm : self.arms) {
    arm->mark_read();
    arm->forget_motion();
  }
  if (self.options.begin_torque) on_all([](ArmDriver& arm) { return arm.begin(); }, true);
  self.running = self.first = true;
}

void FciBackend::finish() {
  auto& self = *self_;
  constexpr double kLongest = 0.5;  // [s]
  const HostTime deadline = later(host_now(), kLongest);
  const auto any_moves = [&self] {
    const HostTime t = host_now();
    return std::any_of(self.arms.begin(), self.arms.end(), [t](const auto& arm) {
      return arm->motion() == ArmMotion::torque && arm->mode(t) == ArmMode::move;
    });
  };
  for (const auto& arm : self.arms) {
    arm->release();  // hold starts here
    if (arm->is_unread()) arm->hold(true);
    arm->mark_read();
  }
  while (any_moves() && host_now() < deadline) {
    self.sleep_until(later(host_now(), 0.002));
    self.receive_all();
    for (const auto& arm : self.arms) {
      if (arm->is_unread()) arm->hold(true);
      arm->mark_read();
    }
  }
  std::vector<std::future<RequestAnswer>> leaving;
  for (const auto& arm : self.arms) leaving.push_back(arm->leave(true));
  (void)self.wait_for(std::move(leaving), false);
  for (const auto& sensor : self.sensors) {
    if (sensor) sensor->stop();
  }
  self.running = false;
}

// --- the loop ---

ArmSet FciBackend::wait() {
  auto& self = *self_;
  if (!self.running) return {};
  if (self.options.lockstep) {
    return self.deliver(self.step_of_all(later(host_now(), self.options.lockstep_wait_s)));
  }
  if (self.first) return self.deliver(self.all_once(later(host_now(), self.options.first_states_s)));
  return wait_until(later(host_now(), self.options.silence_s));
}

ArmSet FciBackend::wait_until(HostTime deadline) {
  auto& self = *self_;
  if (!self.running) return {};
  while (true) {
    if (self.unread().empty()) self.sleep_until(deadline);  // ends at once if a state has come meanwhile
    self.receive_all();
    const ArmSet due = self.unread();
    if (!due.empty() || host_now() >= deadline) return self.deliver(due);
  }
}

// Waits for a new state of every arm, at most until `deadline`. Arms with a state are held meanwhile.
ArmSet FciBackend::Implementation::all_once(HostTime deadline) {
  FirstStates states;
  while (true) {
    receive_all();
    if (unread() == ArmSet::all(arms.size()) || host_now() >= deadline) return unread();
    for (ArmIndex i = 0; i < arms.size(); ++i) {
      if (!arms[i]->is_unread() || !states.is_to_be_held(i, arms[i]->newest().message_id)) continue;
      arms[i]->hold(false);
    }
    sleep_until(deadline);
  }
}

// Waits for the states of one step: the same number from all connected arms.
constexpr double kSlice = 0.005;  // [s], of waiting in lock-step
ArmSet FciBackend::Implementation::step_of_all(HostTime deadline) {
  const HostTime patience = later(host_now(), options.silence_s);
  while (true) {
    receive_all();
    std::uint64_t newest = 0;
    bool complete = true, moving = false;
    ArmSet here;
    for (ArmIndex i = 0; i < arms.size(); ++i) {
      if (!arms[i]->takes_part()) continue;
      here |= ArmSet::of(i);
      moving = moving || arms[i]->mode(host_now()) == ArmMode::move;
      newest = std::max(newest, arms[i]->newest().message_id);
    }
    for (ArmIndex i = 0; i < arms.size(); ++i) {
      if (!here.contains(i)) continue;
      complete = complete && arms[i]->is_unread() && arms[i]->newest().message_id == newest;
    }
    if (complete && !here.empty()) return here;
    // If no arm moves, the world may be paused.
    const HostTime until = moving ? deadline : patience;
    if (host_now() >= until) return unread() & here;
    // In slices, because a lost arm sends no datagram.
    sleep_until(std::min(until, later(host_now(), kSlice)));
  }
}

ArmSet FciBackend::Implementation::deliver(ArmSet due) {
  for (ArmIndex i = 0; i < arms.size(); ++i) {
    if (due.contains(i)) arms[i]->mark_read();
  }
  advance_time(due);
  return due;
}

void FciBackend::Implementation::advance_time(ArmSet due) {
  const HostTime before = woken;
  woken = host_now();
  const std::uint64_t id = due.empty() ? step_id : arms[due.first()]->newest().message_id;
  if (first) {
    first = false;
    begun = woken;
    step_id = id;
    now = {};
    return;
  }
  if (!options.lockstep) {
    now = {woken.ns - begun.ns};
    return;
  }
  constexpr std::uint64_t kJump = 1000;  // a jump means another world after a reconnection
  if (due.empty()) {
    now = now + (woken - before);
  } else {
    const bool in_order = id > step_id && id - step_id < kJump;
    now = now + std::chrono::milliseconds(in_order ? static_cast<std::int64_t>(id - step_id) : 1);
    step_id = id;
  }
}

void FciBackend::read(ArmSet due, std::span<ArmState> states) {
  auto& self = *self_;
  for (ArmIndex i = 0; i < self.arms.size(); ++i) {
    if (due.contains(i)) {
      self.arms[i]->fill(self.woken, states[i]);
    } else if (self.arms[i]->mode(self.woken) == ArmMode::disconnected) {
      states[i].mode = ArmMode::disconnected;
    }
  }
}

void FciBackend::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (ArmIndex i = 0; i < self_->arms.size(); ++i) {
    if (due.contains(i)) self_->arms[i]->command(commands[i].tau_cmd);
  }
}

void FciBackend::request_motion(ArmIndex arm, ArmMotion motion) noexcept {
  self_->arms[arm]->request_motion(motion);
}

bool FciBackend::is_running(ArmIndex arm, ArmMotion motion) const noexcept {
  const ArmDriver& driver = *self_->arms[arm];
  return driver.motion() == motion && driver.mode(self_->woken) == ArmMode::move;
}

const RobotState& FciBackend::packet(ArmIndex arm) const noexcept { return self_->arms[arm]->newest(); }

void FciBackend::command(ArmIndex arm, RobotCommand& command) noexcept { self_->arms[arm]->command(command); }

FciArmConfig fci_arm_config(const SceneArm& arm, const std::string& address) {
  FciArmConfig config;
  config.name = arm.name;
  config.address = address;
  config.model = build_arm_model(arm);
  config.hand = hand_load(arm);
  if (config.hand.mass > 0) config.hand_declared = declared_hand(config.hand);
  const ArmConfig requested = arm_config(arm);
  config.frames = requested.frames;
  config.tool = requested.tool;
  config.load = requested.load;
  config.joint_stiffness = arm.joint_stiffness;
  config.cartesian_stiffness = arm.cartesian_stiffness;
  config.thresholds = arm.collision;
  if (!config.thresholds && !(arm.fci && arm.fci->keep_collision_thresholds)) {
    config.thresholds = careful_thresholds(*config.model);
  }
  if (arm.fci && !arm.fci->robotiq.empty()) {
    config.end_effector = [name = arm.name, port = arm.fci->robotiq, model = arm.fci->robotiq_model] {
      return robotiq_link(name, port, model);
    };
  } else if (arm.vacuum || (arm.fci && arm.fci->vacuum)) {
    config.end_effector = [name = arm.name, address] { return vacuum_link(name, address); };
  } else if (arm.hand && (!arm.fci || arm.fci->gripper)) {
    config.end_effector = [name = arm.name, address] { return gripper_link(name, address); };
  }
  if (arm.force_sensor) {
    if (!arm.force_sensor->has_counts)
      throw std::invalid_argument(
          "arm '" + arm.name +
          "' has a force sensor without counts_per_n and counts_per_nm: copy both from "
          "the device's own page, with N and N m as its units");
    config.force_sensor = {.who = "arm " + arm.name + ": force sensor",
                           .address = arm.force_sensor->address,
                           .counts_per_n = arm.force_sensor->counts_per_n,
                           .counts_per_nm = arm.force_sensor->counts_per_nm};
  }
  if (arm.fci) {
    config.version = arm.fci->version;
    config.low_pass_hz = arm.fci->low_pass_hz;
    config.recover_at_start = arm.fci->recover_at_start;
    if (!arm.fci->check_model) config.model_check = ModelCheck::off;
  }
  return config;
}

}  // namespace multipanda::fci
