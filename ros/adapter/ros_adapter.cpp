#include "ros/adapter/ros_adapter.hpp"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <limits>
#include <rcutils/logging_macros.h>

#include <fmt/format.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/record_relay.hpp"

namespace multipanda::ros {
namespace {

std::int64_t wall_minus_host_ns() {
  using std::chrono::nanoseconds, std::chrono::system_clock;
  // Takes the reading with the shortest duration, because the thread may be interrupted between both clocks.
  std::int64_t best = 0, shortest = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < 5; ++i) {
    const std::int64_t before = host_now().ns;
    const std::int64_t wall =
        std::chrono::duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
    const std::int64_t after = host_now().ns;
    if (after - before >= shortest) continue;
    shortest = after - before;
    best = wall - (before + (after - before) / 2);
  }
  return best;
}

bool stamps_simulated(const RunContext& run, const RosOptions& options) {
  if (options.time != RosSection::Time::automatic) return options.time == RosSection::Time::simulation;
  for (ArmIndex a = 0; a < run.modes->arm_count(); ++a) {
    if (!run.backend->capabilities(a).simulated) return false;
  }
  return true;
}

std::vector<std::string> rcl_arguments(const RosOptions& options) {
  if (options.arguments.empty()) return {};
  std::vector<std::string> arguments{"--ros-args"};
  arguments.insert(arguments.end(), options.arguments.begin(), options.arguments.end());
  return arguments;
}

}  // namespace

RosAdapter::RosAdapter(const RunContext& run, RosOptions options) : options_(std::move(options)) {
  context_ = std::make_unique<Context>(rcl_arguments(options_));
  node_ = std::make_unique<Node>(*context_, options_.node, options_.name_space);
  build(run);
}

RosAdapter::RosAdapter(const RunContext& run, RosOptions options, rcl_node_t* borrowed)
    : options_(std::move(options)), node_(std::make_unique<Node>(borrowed)) {
  build(run);
}

void RosAdapter::build(const RunContext& run) {
  executor_ = std::make_unique<Executor>();
  stops_ = std::make_unique<Executor>();
  AdapterContext context;
  static_cast<RunContext&>(context) = run;
  context.context = context_.get();
  context.node = node_.get();
  context.executor = executor_.get();
  context.stops = stops_.get();
  context.options = &options_;
  context.counters = &counters_;
  context.stamps.simulated = stamps_simulated(run, options_);
  context.stamps.wall_minus_host_ns = wall_minus_host_ns();
  context.diagnostics = [this] { return diagnostics(); };
  context.warn = [this](const std::string& topic, const std::string& text) { warn(topic, text); };
  run_ = std::make_unique<AdapterContext>(std::move(context));
  make_parts();
  for (Executor* executor : {executor_.get(), stops_.get()}) {
    executor->on_failure([this](const std::string& source, const std::string& text) {
      {
        const std::lock_guard lock(warn_mutex_);
        last_failure_ = source + ": " + text;
      }
      warn(source, "a callback failed: " + source + ": " + text);
    });
  }
  relay_ = std::make_unique<RecordRelay>(*run.layout, parts_,
                                         [this](const std::string& text) { warn("publishing", text); });
  executor_->start();
  stops_->start();
}

void RosAdapter::make_parts() {
  const auto add = [this](AdapterParts parts) {
    std::move(parts.begin(), parts.end(), std::back_inserter(parts_));
  };
  const Inputs* inputs = nullptr;
  if (options_.controllets) add(make_controllets(*run_, inputs));
  if (options_.arms || options_.motions) add(make_arms(*run_));
  if (options_.state) add(make_state(*run_));
  add(make_compat(*run_, inputs));
  for (const auto& part : parts_) {
    if (part->needs_loop()) in_loop_.push_back(part.get());
  }
}

RosAdapter::~RosAdapter() {
  for (auto* executor : {stops_.get(), executor_.get()}) {
    if (executor != nullptr) executor->stop();  // no more callbacks
  }
  relay_.reset();  // no more records
  parts_.clear();
}

void RosAdapter::take(const CycleRecord& record) {
  relay_->take(record);
  counters_.records_dropped.store(relay_->dropped(), std::memory_order_relaxed);
}

void RosAdapter::take(const Event& event) { relay_->take(event); }

void RosAdapter::on_loop(const Tick& tick, const Backend& backend) {
  for (AdapterPart* part : in_loop_) part->on_loop(tick, backend);
}

std::vector<Diagnostic> RosAdapter::diagnostics() const {
  std::vector<Diagnostic> lines;
  Diagnostic own{.name = "callbacks"};
  if (const auto failures = executor_->failures() + stops_->failures(); failures > 0) {
    const std::lock_guard lock(warn_mutex_);
    own.level = Diagnostic::Level::error;
    own.message = fmt::format("{} callbacks failed, most recently {}", failures, last_failure_);
  }
  lines.push_back(std::move(own));
  for (const auto& part : parts_) {
    auto more = part->diagnostics();
    std::move(more.begin(), more.end(), std::back_inserter(lines));
  }
  return lines;
}

void RosAdapter::warn(const std::string& topic, const std::string& text) {
  constexpr auto kNotMoreOftenThan = std::chrono::seconds(1);
  {
    const std::lock_guard lock(warn_mutex_);
    const HostTime now = host_now();
    const auto [last, first] = warned_.try_emplace(topic, now);
    if (!first && now - last->second < kNotMoreOftenThan) return;
    last->second = now;
  }
  RCUTILS_LOG_WARN_NAMED("multipanda", "%s", text.c_str());
}

}  // namespace multipanda::ros
