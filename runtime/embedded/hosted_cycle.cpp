#include "runtime/embedded/hosted_cycle.hpp"

#include <algorithm>
#include <chrono>
#include <stdexcept>

#include "scene/build.hpp"

namespace multipanda {

HostedCycle::HostedCycle(Scene scene, const Registry& registry, HostedOptions options)
    : scene_(std::move(scene)), options_(std::move(options)) {
  if (options_.arms.size() != scene_.arms.size()) {
    throw std::invalid_argument("one description of each arm's interfaces is expected");
  }
  CycleConfig config = build_cycle_config(scene_, options_.ring_cycles);
  std::vector<InterfaceBackend::Arm> arms;
  for (ArmIndex i = 0; i < scene_.arms.size(); ++i) {
    models_.push_back(config.arms[i].model);
    config.arms[i].safety.period_s = options_.period_s;
    arms.push_back({.host = options_.arms[i],
                    .model = config.arms[i].model,
                    .config = arm_config(scene_.arms[i]),
                    .safety = config.arms[i].safety});
  }
  backend_ = std::make_unique<InterfaceBackend>(std::move(arms), options_.period_s);
  cycle_ = std::make_unique<ControlCycle>(config, registry, *backend_);
  if (options_.stop_after_gaps) modes().stop_after_gaps();
  modes().schedule(build_schedule(scene_, modes()));
  start_set_ = start_set(scene_, modes());
  modes().activate_at_start(start_set_);  // in the first step; arms that are not ready then start later
  if (options_.make_adapter) {
    adapter_ = options_.make_adapter({.scene = &scene_,
                                      .modes = &modes(),
                                      .backend = backend_.get(),
                                      .layout = &cycle_->layout(),
                                      .models = models_});
  }
  if (options_.trace)
    trace_ = std::make_unique<HostedTrace>(*options_.trace, options_.arms, cycle_->layout(), scene_.text,
                                           options_.period_s, options_.report);
  relay_ = std::thread([this] { run_relay(); });
}

HostedCycle::~HostedCycle() {
  ending_.store(true, std::memory_order_release);
  relay_.join();
}

std::vector<std::string> HostedCycle::joint_names(ArmIndex arm) const {
  if (!options_.arms[arm].joints.empty()) return options_.arms[arm].joints;
  std::vector<std::string> names;
  for (std::size_t i = 0; i < joint_count(arm); ++i) {
    names.push_back(scene_.arms[arm].name + "_joint" + std::to_string(i + 1));
  }
  return names;
}

void HostedCycle::activate() noexcept {
  backend_->begin();
  taking_.fill(0);
  took_ = {};
  activated_ = cycle_->data().tick.t;
  modes().begin_anew();  // requests to an inactive controller must not move its arms
  modes().start_when_ready(start_set_);
  active_.store(true, std::memory_order_release);
}

bool HostedCycle::step(double period_s) noexcept {
  cycle_->step(backend_->advance(period_s));
  backend_->share_stopped(modes().stopped());
  const bool any = watch_arms();
  if (trace_) trace_->step_done(cycle_->data().tick);
  return any;
}

// Sets `ready` to the arms that initially active controllets may use from the next step on. Returns false if
// no arm can be commanded.
bool HostedCycle::watch_arms() {
  const auto& states = cycle_->data().state;
  const auto& conditions = cycle_->data().condition;
  bool any = false;
  ArmSet settled, lost;
  for (ArmIndex i = 0; i < states.size(); ++i) {
    const bool takes = conditions[i].usable;
    taking_[i] = takes ? std::min(taking_[i] + 1, kSettled) : 0;
    if (taking_[i] == kSettled) settled |= ArmSet::of(i);
    if (takes) took_ |= ArmSet::of(i);
    if (!takes && took_.contains(i)) lost |= ArmSet::of(i);
    any = any || takes || states[i].mode == ArmMode::recovering;
  }
  const bool late = seconds(cycle_->data().tick.t - activated_) > kTimeout;
  // later only a request activates them
  modes().give_up_starts(late ? ArmSet::all(states.size()) : lost);
  modes().set_ready(settled);
  return any;
}

void HostedCycle::deactivate() noexcept {
  backend_->leave();
  modes().start_when_ready(0);
  if (trace_ && is_active()) trace_->end(cycle_->data().tick.cycle);
  active_.store(false, std::memory_order_release);
}

void HostedCycle::run_relay() {
  while (true) {
    const bool last = ending_.load(std::memory_order_acquire);
    const bool measured = trace_ && (last || trace_->over());  // before the last of its records is taken
    const bool busy = relay();
    if (measured && !busy) trace_->write(records_dropped());
    if (last && !busy) return;
    if (busy) continue;
    if (!active_.load(std::memory_order_acquire)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      continue;
    }
    // As in a session: sleeps until the next record is due, then polls often.
    constexpr auto kLook = std::chrono::microseconds(100);
    const auto expected =
        last_record_ + std::chrono::nanoseconds(static_cast<std::int64_t>(options_.period_s * 0.95e9));
    const auto now = host_now();
    std::this_thread::sleep_for(expected > now ? std::max<std::chrono::nanoseconds>(expected - now, kLook)
                                               : kLook);
  }
}

bool HostedCycle::relay() {
  RecordRing& ring = *cycle_->record();
  bool busy = false;
  while (const Event* event = ring.events.front()) {
    busy = true;
    if (adapter_) adapter_->take(*event);
    ring.events.pop();
  }
  for (int n = 0; n < 256; ++n) {
    const CycleRecord* record = ring.ring.front();
    if (record == nullptr) break;
    busy = true;
    if (adapter_) adapter_->take(*record);
    if (trace_) trace_->take(*record);
    last_record_ = record->start;
    ring.ring.pop();
  }
  return busy;
}

}  // namespace multipanda
