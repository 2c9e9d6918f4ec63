#include "benchmarks/soak/fault_storm.hpp"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <limits>
#include <sys/resource.h>

#include <fmt/format.h>

namespace multipanda {
namespace {

constexpr double kCalm = 1.0;  // after a fault, arms may still be returning to their state [s]
constexpr std::array<ArmError, 4> kErrors{ArmError::joint_reflex, ArmError::cartesian_reflex,
                                          ArmError::joint_velocity_violation,
                                          ArmError::self_collision_avoidance_violation};

// How often each fault comes, relative to the others.
double weight(Fault fault) {
  switch (fault) {
    case Fault::lost_answers:
    case Fault::late_answers:
      return 5;
    case Fault::reflex:
    case Fault::lost_states:
    case Fault::client_stall:
      return 3;
    case Fault::client_lost:
    case Fault::full_disk:
    case Fault::slow_disk:
      return 0.5;
    default:
      return 2;
  }
}

constexpr std::size_t kRing = 500;     // records; small, so that it overflows
constexpr rlim_t kFullAt = 64 * 1024;  // bytes: less than two seconds of an arm

void limit_files(rlim_t bytes) {
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  limit.rlim_cur = std::min(bytes, limit.rlim_max);
  setrlimit(RLIMIT_FSIZE, &limit);
}

}  // namespace

std::string_view name_of(Fault fault) {
  constexpr std::array<std::string_view, static_cast<std::size_t>(Fault::count_)> kNames{
      "reflex",       "cable",       "user stop", "push",       "lost answers", "late answers", "lost states",
      "client stall", "client lost", "switches",  "parameters", "goals",        "full disk",    "slow disk"};
  return kNames[static_cast<std::size_t>(fault)];
}

FaultStorm::FaultStorm(fci::SimulatedRun& run, InstanceSet work, std::uint64_t seed, double mean_interval_s,
                       std::function<void(Fault, double)> disk)
    : run_(run),
      work_(work),
      draw_(seed),
      mean_interval_s_(mean_interval_s),
      next_s_(2),
      disk_(std::move(disk)),
      arms_(run.modes().arm_count()),
      centers_(run.modes().instance_count()) {
  for (InstanceIndex i = 0; i < centers_.size(); ++i)
    centers_[i].resize(run.modes().instance(i).inputs().size());
}

void FaultStorm::after(double delay_s, std::function<void()> what) {
  planned_.push_back({run_.time_s() + delay_s, std::move(what)});
}

void FaultStorm::disturb(ArmIndex arm, double for_s) {
  arms_[arm].calm_from_s = std::max(arms_[arm].calm_from_s, run_.time_s() + for_s + kCalm);
  disturbed_ |= ArmSet::of(arm);
}

// A controllet that loses one of its arms leaves all of them to their holds.
void FaultStorm::disturb_group(ArmIndex arm, double for_s) {
  disturb(arm, for_s);
  const Instance& owner = run_.modes().instance(run_.modes().owner(arm));
  for (const ArmIndex other : owner.arm_list()) disturb(other, for_s);
}

void FaultStorm::step() {
  const double t = run_.time_s();
  for (std::size_t i = 0; i < planned_.size();) {
    if (planned_[i].at_s > t) {
      ++i;
      continue;
    }
    const auto what = std::move(planned_[i].what);
    planned_.erase(planned_.begin() + static_cast<std::ptrdiff_t>(i));
    what();
  }
  for (ArmIndex i = 0; i < arms_.size(); ++i) repair_arm(i);
  if (t >= next_return_s_) {
    next_return_s_ = t + 1;
    return_to_work();
  }
  if (t >= next_s_) {
    next_s_ = t - mean_interval_s_ * std::log(1 - draw_.unit());
    inject();
  }
}

void FaultStorm::finish() { next_s_ = std::numeric_limits<double>::infinity(); }

void FaultStorm::inject() {
  double total = 0;
  constexpr auto kCount = static_cast<std::size_t>(Fault::count_);
  for (std::size_t i = 0; i < kCount; ++i) total += weight(static_cast<Fault>(i));
  double x = draw_.between(0, total);
  std::size_t chosen = 0;
  while (chosen + 1 < kCount && x >= weight(static_cast<Fault>(chosen)))
    x -= weight(static_cast<Fault>(chosen++));
  inject(static_cast<Fault>(chosen), static_cast<ArmIndex>(draw_.below(arms_.size())));
}

void FaultStorm::inject(Fault fault, ArmIndex arm) {
  fci::SimulatedTime& world = run_.world();
  const int count = 1 + static_cast<int>(draw_.below(19));
  const double lasts_s = draw_.between(0.05, 3);
  ArmSet reached = ArmSet::of(arm);
  if (arms_[arm].held_by_fault && fault <= Fault::push) return;  // one such fault at a time
  const auto storm = [this](int requests, double spacing_s, auto what) {
    for (int i = 0; i < requests; ++i) after(spacing_s * i, [this, what] { (this->*what)(); });
  };
  switch (fault) {
    case Fault::reflex:
      disturb_group(arm, 0.1);
      world.raise(arm, kErrors[draw_.below(kErrors.size())]);
      break;
    case Fault::cable:
      disturb_group(arm, lasts_s + 2);
      arms_[arm].held_by_fault = true;
      world.pull_cable(arm, true);
      after(lasts_s, [this, arm] {
        run_.world().pull_cable(arm, false);
        arms_[arm].held_by_fault = false;
      });
      break;
    case Fault::user_stop:
      disturb_group(arm, lasts_s);
      arms_[arm].held_by_fault = true;
      world.press_user_stop(arm, true);
      after(lasts_s, [this, arm] {
        run_.world().press_user_stop(arm, false);
        arms_[arm].held_by_fault = false;
      });
      break;
    case Fault::push: {
      disturb_group(arm, 1);
      Vector3 f(draw_.between(-1, 1), draw_.between(-1, 1), draw_.between(-1, 1));
      world.push(arm, draw_.between(5, 30) * f.normalized(), draw_.between(0.1, 1));
      break;
    }
    case Fault::lost_answers:
      disturb_group(arm, 0.05);
      world.lose_answers(arm, count);
      break;
    case Fault::late_answers:
      disturb_group(arm, 0.05);
      world.delay_answers(arm, count, static_cast<std::int64_t>(draw_.between(0.5e6, 3e6)));
      break;
    case Fault::lost_states:
      disturb_group(arm, 0.05);
      world.lose_states(arm, count);
      break;
    case Fault::client_stall:
      for (ArmIndex i = 0; i < arms_.size(); ++i) disturb(i, 0.1);
      reached = ArmSet::all(arms_.size());
      world.stall_client(static_cast<std::int64_t>(draw_.between(1e6, 50e6)),
                         draw_.happens(0.5) ? fci::SimulatedTime::Stall::before_reading
                                            : fci::SimulatedTime::Stall::before_sending);
      break;
    case Fault::client_lost:
      for (ArmIndex i = 0; i < arms_.size(); ++i) disturb(i, 3);
      reached = ArmSet::all(arms_.size());
      world.lose_client();
      break;
    case Fault::switches:
      reached = {};
      storm(50, 0.01, &FaultStorm::request_switch);
      break;
    case Fault::parameters:
      reached = {};
      storm(100, 0.005, &FaultStorm::set_parameter);
      break;
    case Fault::goals:
      reached = {};
      storm(100, 0.005, &FaultStorm::set_goal);
      break;
    case Fault::full_disk:
    case Fault::slow_disk:
      reached = {};
      disk_(fault, lasts_s);
      break;
    case Fault::count_:
      return;
  }
  injected_.push_back({run_.time_s(), fault, reached});
}

// What a user does: recovers arms in a reflex and reconnects lost ones, once no fault holds them.
void FaultStorm::repair_arm(ArmIndex i) {
  Arm& arm = arms_[i];
  const double t = run_.time_s();
  const CycleData& data = run_.data();
  const ArmMode mode = data.state[i].mode;
  const bool usable = data.condition[i].usable;
  if (arm.repair.valid()) {
    if (arm.repair.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
    recoveries_ += arm.repair.get().success ? 1 : 0;
    arm.repair_at_s = -1;
  }
  if (!usable) {
    disturb(i, 0);
    if (arm.held_by_fault || mode == ArmMode::recovering || mode == ArmMode::user_stopped) return;
    if (arm.repair_at_s < 0) arm.repair_at_s = t + draw_.between(0.1, 1);
    if (t < arm.repair_at_s) return;
    if (mode == ArmMode::disconnected)
      arm.repair = run_.world().request(i, Reconnect{});
    else
      arm.repair = run_.world().request(i, RecoverFromError{});
    return;
  }
  if (disturbed_.contains(i) && t >= arm.calm_from_s && !arm.held_by_fault)
    disturbed_ = disturbed_ - ArmSet::of(i);
}

// Gives arms back to their controllet once all of its arms are in torque control.
void FaultStorm::return_to_work() {
  const CycleData& data = run_.data();
  for (InstanceIndex i = 0; i < run_.modes().instance_count(); ++i) {
    const Instance& instance = run_.modes().instance(i);
    const auto& arms = instance.arm_list();
    const bool free = std::all_of(arms.begin(), arms.end(), [&](ArmIndex arm) {
      return data.condition[arm].usable && run_.modes().owner(arm) == arm;  // the instance number of an arm's
                                                                            // hold is that of the arm
    });
    if ((work_ & bit(i)) != 0 && free) post({.activate = bit(i)});
  }
}

void FaultStorm::post(const Request& request) {
  std::uint64_t ticket = 0;
  ++requests_;
  (void)run_.modes().post(std::span(&request, 1), ticket, std::numeric_limits<double>::infinity());
}

// Not gravity compensation: a frictionless arm would drift to its limits after a push.
void FaultStorm::request_switch() {
  const auto i = static_cast<InstanceIndex>(draw_.below(run_.modes().instance_count()));
  if (run_.modes().instance(i).descriptor().type != "gravity_compensation") post({.activate = bit(i)});
}

// Half to one and a half times a parameter's first value, within its bounds.
void FaultStorm::set_parameter() {
  const auto i = static_cast<InstanceIndex>(draw_.below(run_.modes().instance_count()));
  const Instance& instance = run_.modes().instance(i);
  if (instance.parameter_count() == 0) return;
  const std::size_t index = draw_.below(instance.parameter_count());
  const ParameterSpec& spec = instance.parameter_spec(index);
  if (!spec.choices.empty() || spec.initial.empty()) return;
  Request request{
      .kind = Request::Kind::set_parameter, .instance = i, .index = static_cast<std::uint16_t>(index)};
  const double factor = draw_.between(0.5, 1.5);
  request.size = static_cast<std::uint8_t>(instance.parameter_size(index));
  for (std::size_t k = 0; k < request.size; ++k) {
    const double initial = spec.initial[spec.initial.size() == 1 ? 0 : k];
    request.values[k] = std::clamp(factor * initial, spec.min, spec.max);
  }
  post(request);
}

// A goal near the first one of this input: 5 cm for positions, 0.1 rad for joints.
void FaultStorm::set_goal() {
  const auto i = static_cast<InstanceIndex>(draw_.below(run_.modes().instance_count()));
  const Instance& instance = run_.modes().instance(i);
  if ((run_.modes().active() & bit(i)) == 0 || instance.inputs().empty()) return;
  const std::size_t index = draw_.below(instance.inputs().size());
  const Reference& input = instance.inputs()[index];
  const Quantity quantity = input.spec().quantity;
  if (quantity != Quantity::pose && quantity != Quantity::joints) return;
  std::vector<double>& center = centers_[i][index];
  if (center.empty()) {
    if (quantity == Quantity::joints) {
      const JointVector& q = input.joints();
      center.assign(q.begin(), q.end());
    } else {
      const Target here = pose_target(input.pose());
      center.assign(here.values.begin(), here.values.begin() + here.size);
    }
  }
  Request request{
      .kind = Request::Kind::set_target, .instance = i, .index = static_cast<std::uint16_t>(index)};
  request.target.size = static_cast<std::uint8_t>(center.size());
  std::copy(center.begin(), center.end(), request.target.values.begin());
  const bool pose = quantity == Quantity::pose;
  for (std::size_t k = 0; k < (pose ? 3 : center.size()); ++k)
    request.target.values[k] += pose ? draw_.between(-0.05, 0.05) : draw_.between(-0.1, 0.1);
  post(request);
}

DiskTrouble::DiskTrouble(std::filesystem::path folder, RecordLayout layout)
    : file_(std::move(folder) / "disk_trouble.mcap"), layout_(std::move(layout)) {
  std::signal(SIGXFSZ, SIG_IGN);  // a write beyond the limit is an error, as on a full disk
}

DiskTrouble::~DiskTrouble() { end(); }

void DiskTrouble::begin(double at_s, bool full, double lasts_s) {
  if (ring_) return;
  ring_ = std::make_unique<RecordRing>(layout_, kRing);
  full_ = full;
  cycles_ = 0;
  ends_s_ = at_s + lasts_s;
  if (full) {
    limit_files(kFullAt);
    recorder_ = std::make_unique<Recorder>(file_, layout_, *ring_,
                                           std::vector<RecordedArm>(layout_.arms.size()), RecorderOptions{});
  }
}

void DiskTrouble::take(const CycleRecord& cycle) {
  if (!ring_) return;
  ++cycles_;
  if (!ring_->ring.push(cycle)) ring_->dropped_records.fetch_add(1, std::memory_order_relaxed);
  if (cycle.t.seconds() >= ends_s_) end();
}

void DiskTrouble::end() {
  if (!ring_) return;
  limit_files(RLIM_INFINITY);
  // After the slow disk the writer gets only the remaining records.
  if (!recorder_)
    recorder_ = std::make_unique<Recorder>(file_, layout_, *ring_,
                                           std::vector<RecordedArm>(layout_.arms.size()), RecorderOptions{});
  const RecorderStatus status = recorder_->stop();
  if (status.cycles + status.cycles_lost != cycles_)
    findings_.push_back(fmt::format("of {} records {} were taken and {} counted as lost", cycles_,
                                    status.cycles, status.cycles_lost));
  if (cycles_ > 2 * kRing && status.missing().empty())
    findings_.push_back("a log is incomplete, but its recorder reports that nothing is missing");
  written_ += status.cycles;
  lost_ += status.cycles_lost;
  recorder_.reset();
  ring_.reset();
  std::error_code error;
  std::filesystem::remove(file_, error);
}

}  // namespace multipanda
