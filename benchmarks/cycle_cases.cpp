#include <fmt/format.h>

#include "benchmarks/cases.hpp"

namespace multipanda::bench {
namespace {

Case cycle_case(const std::string& name, const Arms& arms, std::size_t count, const ControlletType& type,
                const Registry& registry, const std::vector<std::string>& features) {
  const std::shared_ptr<MotionLoop> loop = motion_loop(arms, count, type, registry, features);
  const InstanceSet meant = loop->cycle.modes().active();
  return {name, [loop] { loop->step(); }, [loop, meant] { loop->expect_active(meant); }};
}

}  // namespace

std::vector<Case> cycle_cases(const Arms& arms, const Registry& registry, const Filter& selected) {
  std::vector<Case> cases;
  for (const auto& type : registry.controllets()) {
    const auto add = [&](std::size_t count, const std::vector<std::string>& features) {
      if (count % type.descriptor.arms != 0 || count < type.descriptor.arms + type.descriptor.observes)
        return;
      const std::string plus = features.empty() ? "" : "+" + features.front();
      const std::string name = fmt::format("cycle_us/{}{}/{}", type.descriptor.type, plus, count);
      if (selected(name)) cases.push_back(cycle_case(name, arms, count, type, registry, features));
    };
    for (const std::size_t count : kArmCounts) add(count, {});
    for (const auto& feature : registry.features()) {
      add(1, {feature.descriptor.type});
      add(2, {feature.descriptor.type});
    }
  }
  return cases;
}

std::vector<RealtimeFactor> measure_realtime_factor(const Registry& registry, std::size_t chunks,
                                                    std::size_t cycles, double budget_s,
                                                    const Filter& selected) {
  struct Run {
    std::string name;
    std::unique_ptr<SimulationLoop> loop;
    std::vector<double> factors;
  };
  std::vector<Run> runs;
  const auto add = [&](const std::string& name, std::size_t count, const std::vector<std::string>& features) {
    if (!selected("realtime_factor/" + name)) return;
    runs.push_back({name, std::make_unique<SimulationLoop>(count, registry, features), {}});
  };
  for (const std::size_t count : kArmCounts) {
    add(std::to_string(count), count, {});
    if (count == 2) add("2+features", count, {"collision_avoidance", "manipulability"});
  }
  const HostTime begin = host_now();
  for (std::size_t chunk = 0; chunk < chunks && seconds(host_now() - begin) < budget_s; ++chunk) {
    for (Run& run : runs) {
      const HostTime before = host_now();
      for (std::size_t i = 0; i < cycles; ++i) run.loop->step();
      const double simulated = static_cast<double>(cycles) * MujocoBackend::kPeriod;
      run.factors.push_back(simulated / seconds(host_now() - before));
    }
  }
  std::vector<RealtimeFactor> factors;
  for (Run& run : runs) {
    run.loop->verify();
    factors.push_back({run.name, figures_of(run.factors).median});
  }
  return factors;
}

}  // namespace multipanda::bench
