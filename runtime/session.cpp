#include "runtime/session.hpp"

#include <algorithm>
#include <chrono>

#include "backends/simulation_view.hpp"
#include "runtime/reach.hpp"
#include "scene/build.hpp"
#include "scene/flange_load.hpp"
#include "support/machine.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kLoopRing = 2048;  // cycles between loop and relay: bridges a stall of two seconds
constexpr std::size_t kLogRingBytes = 64u << 20;
constexpr std::chrono::seconds kPatience{1};  // after the hold, in case the world is paused
constexpr std::size_t kMargin = 64;           // cycles kept free in a ring by an unpaced loop

std::size_t log_ring_cycles(const RecordLayout& layout) {
  const std::size_t bytes = sizeof(CycleRecord) + layout.arms.size() * sizeof(ArmSample) +
                            layout.max_references * sizeof(ReferenceSample) +
                            layout.output_count * sizeof(double);
  return std::clamp<std::size_t>(kLogRingBytes / bytes, 2048, 8192);
}

bool has_room(const RecordRing& ring) {
  return ring.ring.size() + kMargin < ring.ring.capacity() && ring.events.size() * 2 < ring.events.capacity();
}

bool simulates(const Backend& backend) {
  for (ArmIndex arm = 0; arm < backend.arm_count(); ++arm) {
    if (!backend.capabilities(arm).simulated) return false;
  }
  return true;
}

void sleep_us(int us) { std::this_thread::sleep_for(std::chrono::microseconds(us)); }

}  // namespace

Session::Session(Scene scene, const Registry& registry, SessionOptions options)
    : scene_(with_connections(std::move(scene), options.backend)),
      registry_(registry),
      options_(std::move(options)),
      latest_(scene_.arms.size()) {
  duration_s_ = options_.duration_s.value_or(scene_.duration_s);
  build();
  if (!options_.record.empty()) open_log();
  if (!options_.socket.empty()) open_socket();
  if (options_.make_adapter) {
    adapter_ = options_.make_adapter({.scene = &scene_,
                                      .modes = &modes(),
                                      .backend = backend_.backend.get(),
                                      .layout = &cycle_->layout(),
                                      .models = models_});
  }
}

Session::~Session() {
  live_.reset();
  stop();
  if (loop_.joinable()) loop_.join();
  if (relay_.joinable()) relay_.join();
  adapter_.reset();
}

void Session::build() {
  CycleConfig config = build_cycle_config(scene_, kLoopRing);
  std::vector<JointVector> tau_max;
  for (const auto& arm : config.arms) {
    models_.push_back(arm.model);
    tau_max.push_back(arm.safety.joints.tau_max);
  }
  if (options_.make_backend) {
    backend_ = {.backend = options_.make_backend(scene_), .description = "another"};
  } else {
    // The monitor needs the cycle, which needs the backend: what the backend reports before is kept.
    const auto report = [this](const std::string& text) {
      const std::lock_guard lock(early_news_mutex_);
      monitor_ ? monitor_->add_news(text) : early_news_.push_back(text);
    };
    backend_ = make_backend(scene_, registry_, options_.backend, {.paced = options_.paced, .report = report});
  }
  cycle_ = std::make_unique<ControlCycle>(std::move(config), registry_, *backend_.backend);
  auto timeline = build_schedule(scene_, modes());
  Reach reach(models_);
  for (ArmIndex i = 0; i < models_.size(); ++i)
    reach.set_end_effector(i, arm_config(scene_.arms[i]).frames.X_FE);
  reach.check(timeline, modes());
  modes().schedule(std::move(timeline));
  modes().activate_at_start(start_set(scene_, modes()));
  const std::lock_guard lock(early_news_mutex_);
  monitor_ = std::make_unique<RunMonitor>(
      cycle_->layout(), std::move(tau_max),
      [this](std::size_t arm, Intervention rule) { return cycle_->safety().counted(arm, rule); });
  for (const auto& text : early_news_) monitor_->add_news(text);
}

void Session::open_socket() {
  LiveInputContext context{.scene = scene_.name,
                           .modes = &modes(),
                           .backend = backend_.backend.get(),
                           .latest = &latest_,
                           .models = models_,
                           .rotations = {}};
  for (const auto& object : scene_.objects) context.rotations.emplace(object.name, object.X_WO.rotation);
  for (const auto& arm : scene_.arms) context.flanges.push_back(flange_load(arm));
  try {
    live_ = std::make_unique<LiveServer>(options_.socket, context);
  } catch (const SocketTaken&) {
    if (options_.second_socket.empty()) throw;
    live_ = std::make_unique<LiveServer>(options_.second_socket, context);
  }
}

void Session::open_log() {
  directory_ = make_run_directory(options_.record, scene_.name);
  log_ = directory_ / "log.mcap";
  const std::size_t capacity =
      options_.ring_cycles != 0 ? options_.ring_cycles : log_ring_cycles(cycle_->layout());
  log_ring_ = std::make_unique<RecordRing>(cycle_->layout(), capacity);
}

void Session::start() {
  if (log_ring_) {
    std::vector<RecordedArm> arms;
    for (std::size_t i = 0; i < models_.size(); ++i) {
      const ArmConfig config = arm_config(scene_.arms[i]);
      arms.push_back(
          {.model = models_[i], .frames = config.frames, .tool = config.tool, .load = config.load});
    }
    RecorderOptions recorder_options;
    recorder_options.model_every = options_.model_every;
    recorder_options.info = describe_machine();
    recorder_options.info["scene"] = scene_.name;
    recorder_options.info["scene_path"] = scene_.path;
    recorder_options.info["seed"] = std::to_string(scene_.seed);
    recorder_options.info["plant"] = scene_.plant.name;
    recorder_options.info["backend"] = backend_.description;
    recorder_options.info["paced"] = options_.paced ? "true" : "false";
    recorder_options.attachments.push_back(
        {.name = "scene.yaml", .media_type = "application/yaml", .data = scene_.text});
    recorder_ = std::make_unique<Recorder>(log_, cycle_->layout(), *log_ring_, std::move(arms),
                                           std::move(recorder_options));
  }
  std::vector<bool> simulated;
  for (ArmIndex arm = 0; arm < models_.size(); ++arm)
    simulated.push_back(backend().capabilities(arm).simulated);
  reflexes_ =
      std::make_unique<ReflexWatch>(cycle_->layout(), error_limits(scene_, models_, simulated), directory_);
  relay_ = std::thread([this] { run_relay(); });
  loop_ = std::thread([this] { run_loop(); });
}

// --- loop thread ---

void Session::run_loop() {
  ThreadSetup thread = options_.thread;
  if (!options_.paced) thread.fifo_priority.reset();
  setup_ = set_up_thread(thread);
  bool runs = false;
  try {
    backend().start();
    runs = true;
    // What was asked while real arms were being connected moves none of them.
    if (!simulates(backend())) modes().begin_anew();
    started_ = host_now();
    first_cycle_ = cycle_->data().tick.cycle;
    cycle_->run([this] { return keep_on(); });
    ended_ = host_now();
    for (ArmIndex arm = 0; arm < backend().arm_count(); ++arm)
      connections_at_end_.push_back(backend().connection(arm));
    runs = false;
    backend().finish();
    if (const auto* simulation = simulation_of(backend());
        simulation != nullptr && !simulation->fault().empty()) {
      problem_ = "the simulation failed: " + simulation->fault();
    }
  } catch (...) {
    failure_ = std::current_exception();
    if (ended_ == HostTime{}) ended_ = host_now();
    if (runs) leave_arms_safe();
  }
  loop_ended_.store(true, std::memory_order_release);
  const std::lock_guard lock(end_mutex_);
  end_changed_.notify_all();
}

// After an exception, which a second one must not hide.
void Session::leave_arms_safe() noexcept {
  try {
    backend().finish();
  } catch (...) {
    monitor_->add_news("the arms could not be left in order after a failure: stop them by hand");
  }
}

// Called between two steps. All reasons to end or delay a run are handled here, outside of step().
bool Session::keep_on() {
  const Tick& tick = cycle_->data().tick;
  if (tick.cycle == first_cycle_) return true;
  if (tick.cycle == first_cycle_ + 1) first_ = tick.t;
  if (options_.on_loop) options_.on_loop(tick, backend());
  if (adapter_) adapter_->on_loop(tick, backend());
  if (is_over(tick)) return false;
  if (!options_.paced) wait_for_room();
  return true;
}

bool Session::is_over(const Tick& tick) {
  if (!closing_ && stop_requested_.load(std::memory_order_acquire)) {
    closing_ = true;
    modes().stop(ArmSet::all(modes().arm_count()));
    const std::chrono::nanoseconds hold(LoopTime::from_seconds(options_.hold_s).ns);
    close_at_ = tick.t + hold;
    close_by_ = host_now() + hold + kPatience;
    end_ = RunEnd::stopped;
  }
  if (closing_) return tick.t >= close_at_ || host_now() >= close_by_;
  const auto period = std::chrono::nanoseconds(static_cast<std::int64_t>(backend().period() * 1e9 + 0.5));
  if (duration_s_ > 0 &&
      (tick.t - first_) + period >= std::chrono::nanoseconds(LoopTime::from_seconds(duration_s_).ns)) {
    end_ = RunEnd::duration;
    return true;
  }
  return false;
}

void Session::wait_for_room() {
  while (!has_room(*cycle_->record())) sleep_us(50);
}

// --- relay thread ---

void Session::run_relay() {
  for (;;) {
    const bool last =
        loop_ended_.load(std::memory_order_acquire);  // read before the rings, so that none is missed
    const bool busy = relay();
    monitor_->publish_if_due();
    if (last && !busy) break;
    if (!busy) wait_for_records();
  }
  monitor_->publish();
}

// With an adapter the relay sleeps until the next record is expected and then polls often; without, it may
// take several records at once.
void Session::wait_for_records() {
  constexpr auto kLook = std::chrono::microseconds(100);
  if (!adapter_ || !options_.paced) return sleep_us(options_.paced ? 2000 : 200);
  const auto expected =
      last_record_ + std::chrono::nanoseconds(static_cast<std::int64_t>(backend().period() * 0.95e9));
  const auto now = host_now();
  std::this_thread::sleep_for(expected > now ? std::max<std::chrono::nanoseconds>(expected - now, kLook)
                                             : kLook);
}

// Relays all available records. In an unpaced run a full log ring stops the relay and thereby the loop; in a
// paced run the record is counted as lost. Events come first, but logs contain both orders.
bool Session::relay() {
  RecordRing& ring = *cycle_->record();
  bool busy = false;
  while (const Event* event = ring.events.front()) {
    busy = true;
    monitor_->take(*event);
    reflexes_->take(*event);
    if (live_) latest_.take(*event);
    if (adapter_) adapter_->take(*event);
    if (log_ring_) {
      while (!options_.paced && log_ring_->events.size() == log_ring_->events.capacity()) sleep_us(50);
      if (!log_ring_->events.push(*event)) ++log_ring_->dropped_events;
    }
    ring.events.pop();
  }
  for (int n = 0; n < 256; ++n) {  // then events again
    const CycleRecord* record = ring.ring.front();
    if (record == nullptr) break;
    busy = true;
    monitor_->take(*record);
    if (live_) latest_.take(*record);
    explain_errors(*record);
    if (adapter_) adapter_->take(*record);
    if (options_.observer) options_.observer(*record);
    last_record_ = record->start;
    if (log_ring_) {
      while (!options_.paced && log_ring_->ring.size() == log_ring_->ring.capacity()) sleep_us(50);
      if (!log_ring_->ring.push(*record)) ++log_ring_->dropped_records;
    }
    ring.ring.pop();
  }
  if (log_ring_) {  // records that the loop dropped are missing in the log, too
    const auto lost = ring.dropped_records.exchange(0), lost_events = ring.dropped_events.exchange(0);
    log_ring_->dropped_records += lost;
    log_ring_->dropped_events += lost_events;
  }
  return busy;
}

// Reports an arm that stopped itself at once, with its explanation.
void Session::explain_errors(const CycleRecord& record) {
  for (auto& report : reflexes_->take(record)) {
    for (ArmIndex arm = 0; arm < modes().arm_count(); ++arm) {
      if (modes().arm_name(arm) == report.arm) latest_.take_stop_reason(arm, report.reason());
    }
    for (const auto& line : report.lines()) monitor_->add_news(line);
    reflex_reports_.push_back(std::move(report));
  }
}

// --- the owner's thread ---

bool Session::wait_for_end(double timeout_s) {
  std::unique_lock lock(end_mutex_);
  return end_changed_.wait_for(lock, std::chrono::duration<double>(timeout_s),
                               [this] { return loop_ended_.load(std::memory_order_acquire); });
}

RunStatus Session::status() const {
  RunStatus status = monitor_->status();
  const bool over = loop_ended_.load(std::memory_order_acquire);
  for (ArmIndex arm = 0; arm < status.arms.size(); ++arm) {
    status.arms[arm].connection = over && arm < connections_at_end_.size()
                                      ? connections_at_end_[arm]
                                      : backend_.backend->connection(arm);
  }
  return status;
}

RunSummary Session::finish() {
  loop_.join();
  relay_.join();
  live_.reset();
  adapter_.reset();
  if (recorder_) recorded_ = recorder_->stop();
  if (failure_) std::rethrow_exception(failure_);
  return summary();
}

RunSummary Session::summary() {
  RunSummary summary;
  const auto us = [](std::int64_t ns) { return static_cast<double>(ns) * 1e-3; };
  const CycleHistogram& times = monitor_->cycle_times();
  const Tick& tick = cycle_->data().tick;
  summary.scene = scene_.name;
  summary.backend = backend_.description;
  summary.end = end_;
  summary.paced = options_.paced;
  summary.cycles = tick.cycle - first_cycle_;
  summary.overruns = backend_.backend->overruns();
  if (summary.cycles > 0) summary.time_s = seconds(tick.t - first_) + backend_.backend->period();
  summary.elapsed_s = seconds(ended_ - started_);
  summary.cycle_us = {.median = us(times.percentile(0.5)),
                      .p99 = us(times.percentile(0.99)),
                      .p999 = us(times.percentile(0.999)),
                      .worst = us(times.max())};
  summary.switches = monitor_->switches();
  for (ArmIndex arm = 0; arm < connections_at_end_.size(); ++arm) {
    if (!connections_at_end_[arm]) continue;
    summary.connections.push_back({.arm = modes().arm_name(arm),
                                   .packets = *connections_at_end_[arm],
                                   .commands_missed = monitor_->commands_missed(arm)});
  }
  for (ArmIndex arm = 0; arm < modes().arm_count(); ++arm) {
    for (std::size_t code = 1; code < static_cast<std::size_t>(Intervention::count_); ++code) {
      const auto rule = static_cast<Intervention>(code);
      const std::uint64_t count = cycle_->safety().counted(arm, rule);
      if (count == 0) continue;
      InterventionReport report{.arm = modes().arm_name(arm), .rule = rule, .count = count};
      for (const auto& seen : monitor_->interventions()) {
        if (seen.arm != report.arm || seen.rule != rule) continue;
        report.episodes = seen.episodes;
        report.first_s = seen.first_s;
        report.controllet = seen.controllet;
      }
      summary.interventions.push_back(std::move(report));
    }
  }
  summary.records_lost = recorder_ ? recorded_.cycles_lost : cycle_->record()->dropped_records.load();
  if (recorder_) summary.missing = recorded_.missing();
  summary.log = log_;
  if (!problem_.empty()) summary.problems.push_back(problem_);
  summary.thread = setup_;
  summary.reflexes = reflex_reports_;
  return summary;
}

}  // namespace multipanda
