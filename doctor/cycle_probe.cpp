// multipanda_cycle_probe SCENE CYCLES measures the control cycle of a scene and prints one JSON object. It is
// a separate program because the guard replaces malloc and the locks of the program that it is linked into.
#include <cstdio>
#include <cstdlib>
#include <sys/mman.h>
#include <sys/resource.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/rt/cycle_histogram.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

constexpr std::uint64_t kWarmUp = 100;  // cycles: the first ones fill caches and touch new memory

std::uint64_t interruptions() {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return static_cast<std::uint64_t>(usage.ru_nivcsw);
}

nlohmann::ordered_json measure(const std::string& name, std::uint64_t cycles) {
  OpenedScene opened = open_scene(name);
  MujocoBackend backend(opened.scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(opened.scene), opened.registry, backend);
  cycle.modes().schedule(build_schedule(opened.scene, cycle.modes()));
  cycle.modes().activate_at_start(start_set(opened.scene, cycle.modes()));
  const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  backend.start();
  for (std::uint64_t k = 0; k < kWarmUp; ++k) cycle.step(backend.wait());
  CycleHistogram times;
  LoopGuardCounts sum;
  std::uint64_t done = 0;
  const std::uint64_t before = interruptions();
  for (; done < cycles; ++done) {
    const ArmSet due = backend.wait();  // excludes the step of the world
    if (due.empty() && backend.ended()) break;
    LoopGuard::arm();
    cycle.step(due);
    const LoopGuardCounts counts = LoopGuard::disarm();
    sum.heap_calls += counts.heap_calls;
    sum.lock_calls += counts.lock_calls;
    sum.page_faults += counts.page_faults;
    times.add(cycle.data().stages.total);
  }
  const std::uint64_t after = interruptions();
  backend.finish();
  const auto us = [&](double share) { return static_cast<double>(times.percentile(share)) * 1e-3; };
  return {{"scene", opened.scene.name},
          {"cycles", done},
          {"p50_us", us(0.5)},
          {"p99_us", us(0.99)},
          {"p999_us", us(0.999)},
          {"worst_us", static_cast<double>(times.max()) * 1e-3},
          {"guarded", kLoopGuardWorks},
          {"memory_locked", locked},
          {"heap_calls", sum.heap_calls},
          {"lock_calls", sum.lock_calls},
          {"page_faults", sum.page_faults},
          {"interruptions", after - before}};
}

}  // namespace
}  // namespace multipanda

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("multipanda_cycle_probe SCENE CYCLES\n", stderr);
    return 2;
  }
  try {
    fmt::print("{}\n", multipanda::measure(argv[1], std::strtoull(argv[2], nullptr, 10)).dump());
    return 0;
  } catch (const std::exception& error) {
    const nlohmann::ordered_json answer{{"scene", argv[1]}, {"reason", error.what()}};
    fmt::print("{}\n", answer.dump());
    return 1;
  }
}
