// Worlds with their loops (python_bindings/) on one thread and on several, compared with the bare physics of
// the same scenes on as many threads, measured alternately in one run: the remaining share of the processor's
// scaling. docs/results/benchmarks.md has the figures.
#include <algorithm>
#include <chrono>
#include <fstream>
#include <functional>
#include <optional>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/types/statistics.hpp"
#include "python_bindings/batch.hpp"
#include "scene/load.hpp"

namespace {

using namespace multipanda;
using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kCycles = 50;  // per step

double since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

// Calls per second.
double rate(double seconds, const std::function<void()>& step) {
  const auto begin = Clock::now();
  int count = 0;
  while (since(begin) < seconds) step(), ++count;
  return count / since(begin);
}

double resident_mb() {
  std::ifstream file("/proc/self/statm");
  double pages = 0;
  file >> pages >> pages;
  return pages * 4096 / 1e6;
}

// Physics alone: 50 steps from the initial state, in each world.
class BarePhysics {
 public:
  BarePhysics(const Scene& scene, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k)
      worlds_.push_back(std::make_unique<MujocoBackend>(scene, MujocoOptions{.pace = Pace::unpaced}));
    const World& first = worlds_[0]->world();
    q_.assign(first.data()->qpos, first.data()->qpos + first.model()->nq);
  }

  void step(std::size_t threads) {
    std::atomic<std::size_t> next{0};
    const auto run = [&] {
      for (std::size_t k = next++; k < worlds_.size(); k = next++) {
        World& world = worlds_[k]->world();
        ::mj_resetData(world.model(), world.data());
        std::ranges::copy(q_, world.data()->qpos);
        for (std::uint64_t i = 0; i < kCycles; ++i) ::mj_step(world.model(), world.data());
      }
    };
    std::vector<std::thread> others;
    for (std::size_t t = 1; t < threads; ++t) others.emplace_back(run);
    run();
    for (auto& thread : others) thread.join();
  }

 private:
  std::vector<std::unique_ptr<MujocoBackend>> worlds_;
  std::vector<double> q_;
};

double measure(const std::string& name, std::size_t count, std::size_t threads, int turns, double seconds) {
  const double before = resident_mb();
  Batch one(name, count, 1), many(name, count, threads);
  const std::vector<std::uint8_t> all(count, 1);
  std::vector<WorldStart> starts(count);
  for (std::size_t k = 0; k < count; ++k) starts[k].seed = k + 1;
  one.reset(all, starts);
  const auto begin = Clock::now();
  one.reset(all, starts);
  const double reset_ms = 1e3 * since(begin) / static_cast<double>(count);
  many.reset(all, starts);
  const double each_mb = (resident_mb() - before) / static_cast<double>(2 * count);
  BarePhysics bare(one.scene(), count);
  std::vector<double> rates, scaling, bare_scaling, ratio;
  for (int turn = 0; turn < turns; ++turn) {
    const double slow = rate(seconds, [&] { one.step(all, kCycles); });
    const double fast = rate(seconds, [&] { many.step(all, kCycles); });
    const double bare_slow = rate(seconds, [&] { bare.step(1); });
    const double bare_fast = rate(seconds, [&] { bare.step(threads); });
    rates.push_back(fast * static_cast<double>(count * kCycles) / 1000);
    scaling.push_back(fast / slow);
    bare_scaling.push_back(bare_fast / bare_slow);
    ratio.push_back(scaling.back() / bare_scaling.back());
  }
  fmt::print("| {} | {:.0f} | {:.2f} | {:.2f} | {:.3f} | {:.2f} ms | {:.1f} MB |\n", name, median(rates),
             median(scaling), median(bare_scaling), median(ratio), reset_ms, each_mb);
  std::fflush(stdout);
  return median(ratio);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Worlds on threads beside bare physics on threads (docs/results/benchmarks.md)");
  std::vector<std::string> scenes{"one_arm", "two_arms", "four_arms"};
  std::size_t count = 16, threads = std::max(1u, std::thread::hardware_concurrency());
  int turns = 9;
  double seconds = 0.5;
  std::optional<double> least;
  app.add_option("--scenes", scenes)->capture_default_str();
  app.add_option("--worlds", count)->capture_default_str();
  app.add_option("--threads", threads)->capture_default_str();
  app.add_option("--turns", turns)->capture_default_str()->check(CLI::PositiveNumber);
  app.add_option("--seconds", seconds, "Duration of each measurement")->capture_default_str();
  app.add_option("--require", least, "Smallest ratio of the scalings; exit code 1 below it");
  CLI11_PARSE(app, argc, argv);
  fmt::print("| scene | × real time, {} threads | scaling | of bare physics | ratio | reset | memory |\n",
             threads);
  fmt::print("|---|---|---|---|---|---|---|\n");
  double worst = 1e9;
  for (const auto& scene : scenes) worst = std::min(worst, measure(scene, count, threads, turns, seconds));
  if (!least || worst >= *least) return 0;
  fmt::print(stderr, "the smallest ratio is {:.3f}, below {}\n", worst, *least);
  return 1;
}
