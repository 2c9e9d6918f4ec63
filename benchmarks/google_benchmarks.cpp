#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include "benchmarks/cases.hpp"
#include "benchmarks/results.hpp"

namespace multipanda::bench {
namespace {

// Times calls of `once`. `make` builds heavy objects when the benchmark runs; they are destroyed after it.
template <typename Make>
void add(const std::string& name, Make make) {
  benchmark::RegisterBenchmark(name.c_str(), [make](benchmark::State& state) {
    auto once = make();
    for (auto _ : state) once();
  })->Unit(benchmark::kMicrosecond);
}

// One arm with its states and model, outside any cycle.
struct Bench {
  explicit Bench(const Arms& arms)
      : states(arms.models.size()), world(arms.models, arms.configs), terms(arms.models[0]) {
    next();
  }
  void next() {
    world.read(world.wait(), states);
    terms.update(states[0]);
  }
  std::vector<ArmState> states;
  SmoothMotion world;
  ModelTerms terms;
};

// Each term with all terms that it needs, at a new state per call.
void add_model_terms(const std::shared_ptr<const Arms>& arms) {
  const auto term = [&](const std::string& name, auto compute) {
    add("model/" + name, [arms, compute] {
      return [bench = std::make_shared<Bench>(*arms), compute] {
        bench->next();
        compute(bench->terms);
      };
    });
  };
  term("update_only", [](ModelTerms&) {});
  term("X_WE", [](ModelTerms& t) { benchmark::DoNotOptimize(t.X_WE()); });
  term("J_V_WE", [](ModelTerms& t) { benchmark::DoNotOptimize(t.J_V_WE()); });
  term("M", [](ModelTerms& t) { benchmark::DoNotOptimize(t.M()); });
  term("c", [](ModelTerms& t) { benchmark::DoNotOptimize(t.c()); });
  term("g", [](ModelTerms& t) { benchmark::DoNotOptimize(t.g()); });
  term("task", [](ModelTerms& t) { benchmark::DoNotOptimize(t.task()); });
  term("manipulability", [](ModelTerms& t) { benchmark::DoNotOptimize(t.manipulability()); });
  term("all", [](ModelTerms& t) {
    benchmark::DoNotOptimize(t.task());
    benchmark::DoNotOptimize(t.c());
    benchmark::DoNotOptimize(t.g());
  });
}

// One instance outside the cycle: its arms' model terms, its law, and its features if any are on.
struct LoneInstance {
  LoneInstance(const Arms& arms, const InstanceConfig& config, const Registry& registry)
      : states(arms.models.size()), world(arms.models, arms.configs) {
    for (const auto& model : arms.models) {
      terms.emplace_back(model);
      tau_law.push_back(joint_constant(model->joint_count(), 0));
      tau_feature.push_back(tau_law.back());
    }
    instance = std::make_unique<Instance>(config, registry, ArmBlocks{states, terms, tau_law, tau_feature});
    next();
    (void)instance->start(tick);
  }
  void next() {
    tick.due = world.wait();
    tick.t = world.now();
    ++tick.cycle;
    world.read(tick.due, states);
    for (const auto& arms : {instance->arm_list(), instance->observed_list()}) {
      for (const ArmIndex arm : arms) terms[arm].update(states[arm]);
    }
  }
  std::vector<ArmState> states;
  std::vector<ModelTerms> terms;
  std::vector<JointVector> tau_law, tau_feature;
  SmoothMotion world;
  Tick tick;
  std::unique_ptr<Instance> instance;
};

void add_instances(const std::shared_ptr<const Arms>& arms, const std::shared_ptr<const Registry>& registry) {
  for (const auto& type : registry->controllets()) {
    add("controllet/" + type.descriptor.type, [arms, registry, &type] {
      const auto config = instances_of(type, type.descriptor.arms + type.descriptor.observes).front();
      return [lone = std::make_shared<LoneInstance>(*arms, config, *registry)] {
        lone->next();
        benchmark::DoNotOptimize(lone->instance->update(lone->tick));
      };
    });
  }
  const ControlletType& host = *registry->controllet("gravity_compensation");
  for (const auto& feature : registry->features()) {
    add("feature/" + feature.descriptor.type, [arms, registry, &host, name = feature.descriptor.type] {
      const auto config = instances_of(host, 1, {name}).front();
      return [lone = std::make_shared<LoneInstance>(*arms, config, *registry)] {
        lone->next();
        benchmark::DoNotOptimize(lone->instance->update_features(lone->tick));
      };
    });
  }
}

// A step that executes a switch, with its answer: two Cartesian impedances and DC alternately; a feature.
void add_switching(const std::shared_ptr<const Arms>& arms, const std::shared_ptr<const Registry>& registry) {
  const auto make_loop = [arms, registry] {
    auto loop = std::make_shared<MotionLoop>(
        *arms, 2,
        std::vector<InstanceConfig>{{.name = "left", .type = "cartesian_impedance", .arms = {0}},
                                    {.name = "right", .type = "cartesian_impedance", .arms = {1}},
                                    {.name = "both", .type = "dual_cartesian_impedance", .arms = {0, 1}}},
        *registry);
    loop->activate(loop->set({"both"}));
    return loop;
  };
  const auto step_with = [](MotionLoop& loop, const Request& request) {
    std::uint64_t ticket = 0;
    Answer answer;
    const bool posted = loop.cycle.modes().post(std::span(&request, 1), ticket) == Verdict::accepted;
    loop.step();
    if (!posted || !loop.cycle.modes().poll(ticket, answer) || !answer.accepted()) {
      throw std::runtime_error("a switch was refused");
    }
  };
  add("switch/controllet", [make_loop, step_with] {
    const auto loop = make_loop();
    return [loop, step_with, apart = true]() mutable {
      step_with(*loop, {.activate = apart ? loop->set({"left", "right"}) : loop->set({"both"})});
      apart = !apart;
    };
  });
  add("switch/feature", [make_loop, step_with] {
    const auto loop = make_loop();
    const InstanceIndex both = loop->cycle.modes().find("both");
    const auto index =
        static_cast<std::uint16_t>(loop->cycle.modes().instance(both).find_feature("joint_limits"));
    return [loop, step_with, both, index, on = true]() mutable {
      step_with(*loop, {.kind = Request::Kind::set_feature, .instance = both, .index = index, .on = on});
      on = !on;
    };
  });
}

// The cases of --json, here in sequence instead of in alternation.
void add_cases(const std::shared_ptr<const Arms>& arms, const std::shared_ptr<const Registry>& registry) {
  const auto add_case = [](Case c) {
    benchmark::RegisterBenchmark(c.name.c_str(), [c](benchmark::State& state) {
      for (auto _ : state) c.once();
      if (c.verify) c.verify();
    })->Unit(benchmark::kMicrosecond);
  };
  const Filter all(".*");
  for (Case& c : cycle_cases(*arms, *registry, all)) add_case(std::move(c));
  for (Case& c : bare_cases(*arms, *registry, all)) add_case(std::move(c));
}

void add_simulation(const std::shared_ptr<const Registry>& registry) {
  for (const std::size_t count : kArmCounts) {
    benchmark::RegisterBenchmark(fmt::format("simulation/{}", count).c_str(),
                                 [count, registry](benchmark::State& state) {
                                   SimulationLoop loop(count, *registry);
                                   for (auto _ : state) loop.step();
                                   loop.verify();
                                   state.counters["realtime_factor"] = benchmark::Counter(
                                       static_cast<double>(state.iterations()) * MujocoBackend::kPeriod,
                                       benchmark::Counter::kIsRate);
                                 })
        ->Unit(benchmark::kMicrosecond)
        ->UseRealTime();
  }
}

}  // namespace

int run_google_benchmarks(const std::vector<std::string>& arguments) {
  const auto registry = std::make_shared<const Registry>(Registry::with_builtins());
  const auto arms = std::make_shared<const Arms>(*registry);
  add_model_terms(arms);
  add_instances(arms, registry);
  add_switching(arms, registry);
  add_cases(arms, registry);
  add_simulation(registry);

  std::vector<std::string> words{"multipanda bench"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  int argc = static_cast<int>(argv.size());
  benchmark::Initialize(&argc, argv.data());
  if (benchmark::ReportUnrecognizedArguments(argc, argv.data())) return 2;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}

}  // namespace multipanda::bench
