#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>

#include "benchmarks/cases.hpp"
#include "runtime/run_adapter.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::bench {
namespace {

constexpr std::size_t kCycles = 1000;  // measured in each run
constexpr int kTurns = 3;  // runs with and without the adapter, alternating, so that other load affects both
constexpr std::size_t kWarmUp = 200;

// Forwards everything and measures the time spent in the loop's thread.
class Timed : public RunAdapter {
 public:
  Timed(std::unique_ptr<RunAdapter> inner, std::vector<double>& us) : inner_(std::move(inner)), us_(us) {
    us_.reserve(100'000);
  }
  void take(const CycleRecord& record) override { inner_->take(record); }
  void take(const Event& event) override { inner_->take(event); }
  void on_loop(const Tick& tick, const Backend& backend) override {
    const HostTime before = host_now();
    inner_->on_loop(tick, backend);
    const HostTime after = host_now();
    if (us_.size() < us_.capacity()) us_.push_back(seconds(after - before) * 1e6);
  }

 private:
  std::unique_ptr<RunAdapter> inner_;
  std::vector<double>& us_;
};

// A run for the lifetime of this object, and its cycle times.
class Run {
 public:
  Run(const Registry& registry, MakeRunAdapter make_adapter) {
    Scene scene = load_scene("two_arms", registry);
    scene.timeline.clear();
    SessionOptions options;
    options.duration_s = 0;
    options.make_adapter = std::move(make_adapter);
    options.observer = [this](const CycleRecord& record) {
      if (record.cycle > kWarmUp) us_.push_back(1e-3 * record.stages.total);
      cycles_.store(record.cycle, std::memory_order_release);
    };
    session_.emplace(std::move(scene), registry, std::move(options));
    session_->start();
  }
  void wait_for_cycles() const {
    while (cycles_.load(std::memory_order_acquire) < kCycles + kWarmUp)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::vector<double> finish() {
    session_->stop();
    (void)session_->finish();
    return us_;
  }

 private:
  std::vector<double> us_;
  std::atomic<std::uint64_t> cycles_{0};
  std::optional<Session> session_;
};

std::vector<double> run_client(const std::filesystem::path& client, std::size_t trials) {
  const std::string command = fmt::format("'{}' {}", client.string(), trials);
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("switching by ROS: cannot start the client");
  std::vector<double> times;
  double ms = 0;
  while (std::fscanf(pipe, "%lf", &ms) == 1) times.push_back(ms);
  if (const int status = pclose(pipe); status != 0 || times.size() != trials) {
    throw std::runtime_error(
        fmt::format("switching by ROS: the client ended with {} after {} trials", status, times.size()));
  }
  return times;
}

}  // namespace

RosTimes measure_ros(const Registry& registry, std::size_t trials) {
  RosTimes times;
  const auto client = ros_module_path().parent_path() / "multipanda_ros_switch_client";
  if (!std::filesystem::exists(ros_module_path()) || !std::filesystem::exists(client)) {
    times.missing = "not built";
    return times;
  }
  // A ROS domain of its own unless one is set; the client inherits it.
  setenv("ROS_DOMAIN_ID", std::to_string(1 + getpid() % 100).c_str(), 0);
  const auto make = load_ros_adapter({});
  const auto measure = [&](const MakeRunAdapter& adapter, std::vector<double>& us, bool switching) {
    Run run(registry, adapter);
    if (switching) times.switch_ms = run_client(client, trials);
    run.wait_for_cycles();
    const std::vector<double> more = run.finish();
    us.insert(us.end(), more.begin(), more.end());
  };
  const MakeRunAdapter timed = [&](const RunContext& world) {
    return std::make_unique<Timed>(make(world), times.adapter_us);
  };
  for (int turn = 0; turn < kTurns; ++turn) {
    measure(timed, times.with_us, turn == 0);
    measure(nullptr, times.without_us, false);
  }
  return times;
}

}  // namespace multipanda::bench
