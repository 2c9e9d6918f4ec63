#include "runtime/session.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <unistd.h>

#include <fmt/format.h>

#include "backends/simulation_view.hpp"
#include "common/machine.hpp"
#include "runtime/live_input/socket_path.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kLoopRing = 1024;  // cycles between loop and relay: bridges a stall of a second
// Cycles between relay and recorder, and bytes of further ones while the disk stalls.
constexpr std::size_t kLogRing = 256, kWaitingBytes = 64u << 20;
constexpr std::chrono::seconds kPatience{1};  // additional time after the hold, in case the world is paused
constexpr std::size_t kMargin = 64;           // cycles kept free in a ring by an unpaced loop

std::vector<std::string> free_objects(const Scene& scene) {
  std::vector<std::string> names;
  for (const auto& object : scene.objects) {
    if (!object.fixed) names.push_back(object.name);
  }
  return names;
}

std::size_t waiting_cycles(const RecordLayout& layout) {
  const std::size_t bytes = sizeof(CycleRecord) + layout.arms.size() * sizeof(ArmSample) +
                            layout.max_references * sizeof(ReferenceSample) +
                            layout.output_count * sizeof(double);
  return std::clamp<std::size_t>(kWaitingBytes / bytes, 2048, 8192);
}

bool has_room(const RecordRing& ring) {
  return ring.ring.size() + kMargin < ring.ring.capacity() && ring.events.size() * 2 < ring.events.capacity();
}

bool has_simulated_arm(const Backend& backend) {
  for (ArmIndex arm = 0; arm < backend.arm_count(); ++arm) {
    if (backend.capabilities(arm).simulated) return true;
  }
  return false;
}

bool simulates(const Backend& backend) {
  for (ArmIndex arm = 0; arm < backend.arm_count(); ++arm) {
    if (!backend.capabilities(arm).simulated) return false;
  }
  return true;
}

// Whether the loop keeps up with the wall clock, so that it stalls only with the program.
bool is_on_the_wall_clock(const SessionOptions& options) {
  return options.paced && !options.backend.lockstep;
}

// A stop, or a client that goes, is none.
bool is_fault(const Event& event) {
  if (event.kind == EventKind::arm_mode) {
    const auto mode = static_cast<ArmMode>(event.index);
    return mode == ArmMode::reflex || mode == ArmMode::user_stopped || mode == ArmMode::disconnected;
  }
  return event.kind == EventKind::switched && event.intervention != Intervention::none &&
         event.intervention != Intervention::stop_requested &&
         event.intervention != Intervention::reference_stale;
}

void sleep_us(int us) { std::this_thread::sleep_for(std::chrono::microseconds(us)); }

}  // namespace

Session::Session(Scene scene, const Registry& registry, SessionOptions options)
    : scene_(with_connections(std::move(scene), options.backend)),
      registry_(registry),
      options_(std::move(options)),
      latest_(scene_.arms.size()) {
  if (!options_.moving_bases) refuse_carried_arms(scene_, "this program");
  if (options_.make_adapter) refuse_carried_arms(scene_, "ROS (--ros)");
  duration_s_ = options_.duration_s.value_or(scene_.duration_s);
  for (const auto& arm : scene_.arms) mounts_.push_back(arm.mount);
  build();
  if (!options_.record.empty()) {
    open_log();
  } else if (options_.paced && options_.keep_last) {
    keep_last();
  }
  if (!options_.socket.empty() || options_.share_records) open_live_input();
  if (options_.socket.empty() && options_.paced && !simulates(backend())) offer_stops();
  if (options_.make_adapter) {
    adapter_ = options_.make_adapter({.scene = &scene_,
                                      .modes = &modes(),
                                      .backend = backend_.backend.get(),
                                      .layout = &cycle_->layout(),
                                      .models = models_,
                                      .followed = live_context_.followed,
                                      .newest = [this](ArmIndex arm) { return latest_.sample(arm); }});
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
    // The monitor needs the cycle, which needs the backend: earlier messages of the backend are stored.
    const auto report = [this](const std::string& text) {
      const std::lock_guard lock(early_news_mutex_);
      monitor_ ? monitor_->add_news(text) : early_news_.push_back(text);
    };
    backend_ = make_backend(scene_, registry_, options_.backend, {.paced = options_.paced, .report = report});
  }
  cycle_ = std::make_unique<ControlCycle>(std::move(config), registry_, *backend_.backend);
  modes().schedule(build_schedule(scene_, modes()));
  modes().activate_at_start(start_set(scene_, modes()));
  if (is_on_the_wall_clock(options_)) modes().stop_after_gaps();
  const std::lock_guard lock(early_news_mutex_);
  monitor_ = std::make_unique<RunMonitor>(
      cycle_->layout(), std::move(tau_max),
      [this](std::size_t arm, Intervention rule) { return cycle_->safety().counted(arm, rule); });
  for (const auto& text : early_news_) monitor_->add_news(text);
}

// Not fatal: a run without shared memory still has its socket.
void Session::share_records() {
  std::vector<ArmFrames> frames;
  for (const auto& arm : scene_.arms) frames.push_back(arm_config(arm).frames);
  try {
    shared_ = std::make_unique<SharedRecords>(scene_.name, cycle_->layout(), models_, frames, mounts_);
    events_.emplace(cycle_->layout());
  } catch (const std::runtime_error& error) {
    monitor_->add_news(std::string("no records are shared with other programs: ") + error.what());
  }
}

// Lets a program that moves real arms by itself be stopped like any other run. Failure is not fatal.
void Session::offer_stops() {
  static std::atomic<int> count{0};
  LiveInputContext run{.scene = scene_.name,
                       .modes = &modes(),
                       .backend = backend_.backend.get(),
                       .latest = &latest_,
                       .models = models_,
                       .mounts = mounts_,
                       .rotations = {},
                       .stops_only = true};
  try {
    const auto folder = socket_folder();
    make_private_folder(folder);
    live_ = std::make_unique<LiveServer>(
        folder / fmt::format("{}-{}-{}.sock", scene_.name, getpid(), ++count), std::move(run));
  } catch (const std::exception& error) {
    monitor_->add_news(std::string("`multipanda ctl stop` does not reach this run: ") + error.what());
  }
}

void Session::open_live_input() {
  share_records();
  if (!free_objects(scene_).empty() && has_simulated_arm(backend()))
    poses_ = std::make_unique<ObjectPoses>(scene_);
  live_context_ = {.scene = scene_.name,
                   .modes = &modes(),
                   .backend = backend_.backend.get(),
                   .latest = &latest_,
                   .models = models_,
                   .mounts = mounts_,
                   .rotations = {},
                   .objects = poses_.get(),
                   .records = shared_.get(),
                   .mark =
                       [this](const EpisodeMark& mark) {
                         const std::lock_guard lock(marks_mutex_);
                         marks_.push_back(mark);
                       },
                   .keep = [this] { return keep(); }};
  for (const auto& object : scene_.objects)
    live_context_.rotations.emplace(object.name, object.X_WO.rotation);
  for (const auto& arm : scene_.arms) live_context_.flanges.push_back(flange_load(arm, robot_of(arm)));
  if (options_.socket.empty()) return;
  try {
    live_ = std::make_unique<LiveServer>(options_.socket, live_context_);
  } catch (const SocketTaken&) {
    if (options_.second_socket.empty()) throw;
    live_ = std::make_unique<LiveServer>(options_.second_socket, live_context_);
  }
}

void Session::open_log() {
  directory_ = make_run_directory(options_.record, scene_.name);
  log_ = directory_ / "log.mcap";
  const std::size_t capacity =
      options_.ring_cycles != 0 ? options_.ring_cycles : waiting_cycles(cycle_->layout());
  log_ring_ = std::make_unique<RecordRing>(cycle_->layout(), std::min(capacity, kLogRing));
  most_waiting_ = capacity - log_ring_->ring.capacity();
  std::vector<std::string> objects = free_objects(scene_);
  const std::uint64_t every = options_.log_every.objects;
  if (every == 0 || objects.empty() || !has_simulated_arm(backend())) return;
  // At most the cycles that wait between loop and recorder, so that an unpaced run loses none.
  const std::size_t cycles = cycle_->record()->ring.capacity() + capacity + 1024;
  objects_ = std::make_unique<ObjectRing>(std::move(objects), every, cycles / every + 2);
}

// Failure is not fatal.
void Session::keep_last() {
  try {
    kept_ = std::make_unique<KeptLogs>(
        KeptLogs::Parts{.layout = cycle_->layout(),
                        .arms = recorded_arms(),
                        .options = [this] { return recorder_options(); },
                        .folder = [this] { return reflexes_->folder(); },
                        .report = [this](const std::string& text) { monitor_->add_news(text); }});
  } catch (const std::system_error& error) {
    monitor_->add_news(std::string("the last 30 s are not kept: ") + error.what());
  }
}

KeptLog Session::keep() {
  if (kept_) return kept_->keep();
  if (!log_.empty()) return {log_, answer_now({.success = true, .reason = {}})};
  return {std::filesystem::path(),
          refuse_request("this run does not keep its last 30 s: it needs real time, and no --keep-nothing")};
}

std::vector<RecordedArm> Session::recorded_arms() const {
  std::vector<RecordedArm> arms;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const ArmConfig config = arm_config(scene_.arms[i]);
    arms.push_back({.model = models_[i],
                    .frames = config.frames,
                    .tool = config.tool,
                    .load = config.load,
                    .mount = mounts_[i]});
  }
  return arms;
}

RecorderOptions Session::recorder_options() const {
  RecorderOptions options;
  options.every = options_.log_every;
  options.info = describe_machine();
  options.info["scene"] = scene_.name;
  options.info["scene_path"] = scene_.path;
  options.info["seed"] = std::to_string(scene_.seed);
  options.info["plant"] = scene_.plant.name;
  options.info["backend"] = backend_.description;
  options.info["paced"] = options_.paced ? "true" : "false";
  if (const std::string every = options.every.text(); !every.empty()) options.info["log_every"] = every;
  options.attachments.push_back(
      {.name = "scene.yaml", .media_type = "application/yaml", .data = scene_.text});
  options.objects = objects_.get();
  return options;
}

void Session::start() {
  if (log_ring_)
    recorder_ =
        std::make_unique<Recorder>(log_, cycle_->layout(), *log_ring_, recorded_arms(), recorder_options());
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
    // Requests made while real arms were being connected must not move them.
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

// After an exception, which another one must not hide.
void Session::leave_arms_safe() noexcept {
  try {
    backend().finish();
  } catch (...) {
    monitor_->add_news("the arms could not be stopped properly after a failure: press their user stops");
  }
}

// Called between two steps. Handles all reasons to end or delay a run, outside of step().
bool Session::keep_on() {
  const Tick& tick = cycle_->data().tick;
  if (tick.cycle == first_cycle_) return true;
  if (tick.cycle == first_cycle_ + 1) first_ = tick.t;
  if (options_.on_loop) options_.on_loop(tick, backend());
  if (objects_) objects_->take(tick, backend());
  if (poses_) poses_->take([this](const std::string& name) { return backend().object_pose(name); });
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
  const auto period = std::chrono::nanoseconds(std::llround(backend().period() * 1e9));
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
    pass_waiting();
    monitor_->publish_if_due();
    if (last && !busy && waiting_.empty()) break;
    if (!busy) wait_for_records();
  }
  monitor_->publish();
}

// For an adapter and for readers of the shared records the relay sleeps until the next record is expected and
// then polls often; without, it takes many records at once: to wake costs more than a record.
void Session::wait_for_records() {
  constexpr auto kLook = std::chrono::microseconds(100);
  const bool prompt = adapter_ || (live_ && live_->record_readers() > 0);
  if (!prompt || !options_.paced) return sleep_us(options_.paced ? 10'000 : 200);
  const auto expected =
      last_record_ + std::chrono::nanoseconds(static_cast<std::int64_t>(backend().period() * 0.95e9));
  const auto now = host_now();
  std::this_thread::sleep_for(expected > now ? std::max<std::chrono::nanoseconds>(expected - now, kLook)
                                             : kLook);
}

// Relays available data in the loop's order: events before the record of their cycle. Remaining events
// precede a record that is still to come. In an unpaced run a full log ring stops the relay and thereby the
// loop; in a paced run the record is counted as lost.
bool Session::relay() {
  constexpr int kPerTurn = 256;
  RecordRing& ring = *cycle_->record();
  int taken = 0;
  relay_marks();
  const auto relay_events = [&](std::uint64_t until) {
    for (const Event* event = ring.events.front(); event != nullptr && event->cycle <= until;
         event = ring.events.front()) {
      relay(*event);
      ring.events.pop();
      ++taken;
    }
  };
  for (int n = 0; n < kPerTurn; ++n) {
    const CycleRecord* record = ring.ring.front();
    if (record == nullptr) {
      // Read again after the event: by then the records of earlier cycles are visible.
      const Event* event = ring.events.front();
      if (event != nullptr && ring.ring.front() == nullptr) relay_events(event->cycle);
      break;
    }
    relay_events(record->cycle);
    relay(*record);
    ring.ring.pop();
    ++taken;
  }
  // Other consumers also miss records that the loop dropped.
  const auto lost = ring.dropped_records.exchange(0), lost_events = ring.dropped_events.exchange(0);
  records_lost_ += lost;
  if (shared_) shared_->count_lost(lost, lost_events);
  if (log_ring_) {
    log_ring_->dropped_records += lost;
    log_ring_->dropped_events += lost_events;
  }
  return taken > 0;
}

void Session::relay_marks() {
  std::vector<EpisodeMark> marks;
  {
    const std::lock_guard lock(marks_mutex_);
    marks.swap(marks_);
  }
  for (const EpisodeMark& mark : marks) {
    const std::string text = fmt::format("episode {}: {}", mark.episode, to_string(mark.kind));
    monitor_->add_news(text);
    if (shared_)
      shared_->take(RunEvent{.cycle = mark.cycle, .t = mark.t, .kind = "episode", .arm = "", .text = text});
    if (recorder_) recorder_->mark(mark);
    if (kept_) kept_->take(mark);
  }
}

void Session::relay(const Event& event) {
  monitor_->take(event);
  if (kept_) {
    kept_->take(event);
    if (is_fault(event)) kept_->fault();
  }
  reflexes_->take(event);
  latest_.take(event);
  if (shared_) {
    shared_->take(event);
    for (const RunEvent& seen : events_->take(event)) shared_->take(seen);
  }
  if (adapter_) adapter_->take(event);
  if (!log_ring_) return;
  while (!options_.paced && log_ring_->events.size() == log_ring_->events.capacity()) sleep_us(50);
  if (!log_ring_->events.push(event)) ++log_ring_->dropped_events;
}

void Session::relay(const CycleRecord& record) {
  monitor_->take(record);
  if (kept_) kept_->take(record);
  const auto gap = record.start - last_record_;
  const bool next = last_cycle_ != 0 && record.cycle == last_cycle_ + 1;
  if (is_on_the_wall_clock(options_) && next && gap > GapWatch::kLongest) {
    monitor_->add_news(fmt::format(
        "the program stalled for {:.1f} s: all arms are stopped until they are resumed", seconds(gap)));
    if (kept_) kept_->fault();
  }
  last_cycle_ = record.cycle;
  latest_.take(record);
  const auto reports = explain_errors(record);
  if (kept_ && !reports.empty()) kept_->fault();
  if (shared_) {
    shared_->take(record, modes().stopped());
    std::map<std::string, std::string> reasons;
    for (const auto& report : reports) reasons.emplace(report.arm, report.reason());
    for (const RunEvent& seen : events_->take(record, reasons)) shared_->take(seen);
  }
  reflex_reports_.insert(reflex_reports_.end(), reports.begin(), reports.end());
  if (adapter_) adapter_->take(record);
  if (options_.observer) options_.observer(record);
  last_record_ = record.start;
  if (log_ring_) log(record);
}

void Session::log(const CycleRecord& record) {
  pass_waiting();
  while (!options_.paced && log_ring_->ring.size() == log_ring_->ring.capacity()) sleep_us(50);
  if (waiting_.empty() && log_ring_->ring.push(record)) return;
  if (waiting_.size() < most_waiting_) {
    waiting_.push_back(record);
  } else {
    ++log_ring_->dropped_records;
  }
}

void Session::pass_waiting() {
  for (; !waiting_.empty() && log_ring_->ring.push(waiting_.front()); waiting_.pop_front()) {
  }
}

// Reports an arm that stopped itself at once, with its explanation.
std::vector<ReflexReport> Session::explain_errors(const CycleRecord& record) {
  auto reports = reflexes_->take(record);
  for (const auto& report : reports) {
    for (ArmIndex arm = 0; arm < modes().arm_count(); ++arm) {
      if (modes().arm_name(arm) == report.arm) latest_.take_stop_reason(arm, report.reason());
    }
    for (const auto& line : report.lines()) monitor_->add_news(line);
  }
  return reports;
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

Intervention Session::removed_by(ArmIndex arm) const {
  LatestState::Snapshot snapshot;
  latest_.copy(snapshot);
  return snapshot.arms.at(arm).removed_by;
}

RunSummary Session::finish() {
  loop_.join();
  relay_.join();
  live_.reset();
  adapter_.reset();
  relay_marks();  // marks from after the last cycle
  if (recorder_) recorded_ = recorder_->stop();
  if (kept_) {
    if (failure_ || !problem_.empty()) kept_->fault();
    kept_logs_ = kept_->finish();
    monitor_->publish();
  }
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
  summary.records_lost = recorder_ ? recorded_.cycles_lost : records_lost_;
  if (recorder_) summary.missing = recorded_.missing();
  summary.log = log_;
  summary.kept = kept_logs_;
  if (!problem_.empty()) summary.problems.push_back(problem_);
  summary.thread = setup_;
  summary.reflexes = reflex_reports_;
  return summary;
}

}  // namespace multipanda
