#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <thread>
#include <unistd.h>
#include <vector>

#include <fmt/format.h>

#include "benchmarks/bare/bare_libraries.hpp"
#include "common/text.hpp"
#include "core/model/arm_model.hpp"
#include "core/types/statistics.hpp"
#include "core/types/time.hpp"
#include "experiments/arm_steps.hpp"
#include "experiments/performance_runs.hpp"
#include "experiments/processes.hpp"
#include "logs/npz.hpp"
#include "runtime/command_trace.hpp"
#include "runtime/live_input/socket_path.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda {
namespace {

// Median time of the law of dual_cartesian_impedance for two arms, written directly with Pinocchio and Eigen
// (benchmarks/bare/bare_libraries.hpp): the baseline of a control cycle [us]. It is evaluated once per
// millisecond, so that caches and clock rate are as in a cycle. NaN unless there are two arms of seven
// joints. The calling thread sleeps between evaluations:
// 0.3 s.
double bare_math_us(const std::vector<std::shared_ptr<const ArmModel>>& models) {
  using bench::BareDualImpedance;
  using bench::Vector7;
  constexpr int kEvaluations = 301;
  constexpr double kSwing = 0.2;  // amplitude of the joints' motion [rad]
  if (models.size() < 2 || models[0]->joint_count() != 7 || models[1]->joint_count() != 7)
    return std::numeric_limits<double>::quiet_NaN();
  BareDualImpedance law(*models[0], *models[1], Pose{},
                        {.translational_stiffness = Vector3::Constant(400),
                         .rotational_stiffness = 30,
                         .damping_ratio = 1,
                         .null_space_stiffness = 5});
  std::array<BareDualImpedance::Input, 2> inputs;
  std::vector<double> times;
  double sum = 0;
  for (int k = 0; k < kEvaluations; ++k) {
    for (std::size_t arm = 0; arm < 2; ++arm) {
      const Vector7 q_home = models[arm]->q_home();
      inputs[arm] = {.q = q_home + Vector7::Constant(kSwing * std::sin(0.01 * k)),
                     .dq = Vector7::Constant(kSwing * std::cos(0.01 * k)),
                     .X_W_d = models[arm]->X_WB() * Pose{Matrix3::Identity(), Vector3(0.4, 0, 0.4)},
                     .V_d = Vector6::Zero(),
                     .A_d = Vector6::Zero(),
                     .q_N = q_home};
    }
    const auto begin = std::chrono::steady_clock::now();
    const auto& tau = law.torques(inputs);
    times.push_back(
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count());
    sum += tau[0][0] + tau[1][0];
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  if (!std::isfinite(sum)) return std::numeric_limits<double>::quiet_NaN();
  return median(times);
}

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kPatience = 60;  // waiting time for the generator, which times out earlier [s]
constexpr double kRest = 0.5;     // after the last set-point [s]

std::size_t cycles(double s) { return static_cast<std::size_t>(std::llround(s / kArmPeriod)); }

// CPU and memory of this process, which runs the loop, of the generator and of the machine.
class UsageSeries {
 public:
  UsageSeries(pid_t loop_thread, pid_t generator) : loop_thread_(loop_thread), generator_(generator) {
    last_ = read();
  }

  void sample() {
    const Reading now = read();
    const double dt = seconds(now.at - last_.at);
    const double process = now.process.cpu_s - last_.process.cpu_s,
                 generator = now.generator.present ? now.generator.cpu_s - last_.generator.cpu_s : 0,
                 machine = now.machine.busy_s - last_.machine.busy_s;
    const auto percent = [dt](double cpu_s) { return 100 * cpu_s / dt; };
    rows_.push_back({seconds(now.at - begin()), percent(process), percent(now.loop.cpu_s - last_.loop.cpu_s),
                     percent(now.loop.waited_s - last_.loop.waited_s), percent(generator),
                     percent(std::max(machine - process - generator, 0.0)), now.process.memory_mb,
                     now.machine.load_1min});
    last_ = now;
  }

  std::size_t count() const { return rows_.size(); }
  static Json columns() {
    return Json::parse(
        R"(["t_s", "process_percent", "loop_percent", "loop_waited_percent", "generator_percent",
                           "others_percent", "memory_mb", "load_1min"])");
  }
  Json rows() const { return rows_; }

 private:
  struct Reading {
    HostTime at;
    ProcessUsage process, generator;
    ThreadUsage loop;
    MachineUsage machine;
  };
  HostTime begin() {
    if (begin_ == HostTime{}) begin_ = last_.at;
    return begin_;
  }
  Reading read() const {
    return {host_now(), process_usage(getpid()), process_usage(generator_), thread_usage(loop_thread_),
            machine_usage()};
  }

  pid_t loop_thread_, generator_;
  HostTime begin_;
  Reading last_;
  std::vector<std::vector<double>> rows_;
};

fs::path own_socket() {
  make_private_folder(socket_folder());
  return socket_folder() / fmt::format("experiment-{}.sock", getpid());
}

Json of_summary(const RunSummary& summary) {
  Json thread = Json::array(), interventions = Json::array();
  for (const auto& step : summary.thread)
    thread.push_back({{"what", step.what}, {"done", step.done}, {"reason", step.reason}});
  for (const auto& seen : summary.interventions)
    interventions.push_back({{"arm", seen.arm}, {"rule", to_string(seen.rule)}, {"count", seen.count}});
  return {{"cycles", summary.cycles},   {"overruns", summary.overruns},
          {"faults", summary.faults()}, {"records_lost", summary.records_lost},
          {"thread", thread},           {"interventions", interventions}};
}

}  // namespace

Json run_condition(const PerformanceRun& run, const PerformanceSettings::Condition& condition,
                   std::size_t repeat) {
  const PerformanceSettings& settings = run.settings;
  const double duration_s = run.fast ? settings.fast_duration_s : settings.duration_s;
  const std::string name = fmt::format("{}_{}", condition.name, repeat);
  const OpenedScene opened = changed_scene(run.experiment, settings.scene, settings.plant, condition.set);
  const std::vector<std::string> arms = names_in(opened.scene.arms);

  std::unique_ptr<CommandTrace> trace;
  RunWatch watch;
  SessionOptions options{.paced = true, .backend = run.backend, .duration_s = 0.0, .socket = own_socket()};
  options.observer = [&trace, &watch](const CycleRecord& record) {
    trace->take(record);
    watch.take(record);
  };
  options.on_loop = [&trace](const Tick& tick, const Backend&) { trace->step_done(tick); };
  // A unique name, so that no other node on this machine is taken for it.
  const std::string node = run.ros ? fmt::format("experiment_{}", getpid()) : "";
  if (run.ros) options.make_adapter = load_ros_adapter({.node = node, .name_space = {}, .remaps = {}});
  const fs::path socket = options.socket;
  if (run.viewer != nullptr) run.viewer->prepare(options);
  Session session(opened.scene, opened.registry, std::move(options));
  if (run.rehearsal) watch.extent.emplace(session.scene(), session.models());
  if (run.on_arms()) watch.arms.emplace(session.scene(), session.layout(), session.models(), run.expected);
  const InstanceIndex instance = session.modes().find(condition.controllet);
  if (instance == kNoInstance)
    throw std::invalid_argument("condition " + condition.name + ": the scene has no controllet '" +
                                condition.controllet + "'");
  trace = std::make_unique<CommandTrace>(session.modes().layout(),
                                         CommandTrace::Options{.lead = cycles(settings.lead_s),
                                                               .samples = cycles(duration_s),
                                                               .instance = instance,
                                                               .streaming = true});
  const Viewed viewed(run.viewer, session);
  const double bare_us = bare_math_us(session.models());
  if (run.progress.stopped()) return {};
  session.start();
  GeneratorProcess generator({.program = own_program(),
                              .course = condition.course,
                              .socket = socket,
                              .ros_node = run.ros ? "/" + node : "",
                              .seconds = settings.lead_s + 2 * duration_s + 2 * kPatience,
                              .messages = run.folder / (name + "_generator.txt")});
  const auto over = [&] {
    return watch.stopped(session) || run.progress.stopped() || session.wait_for_end(0);
  };
  const HostTime begin = host_now();
  while (!trace->started() && !over() && generator.running() && seconds(host_now() - begin) < kPatience)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  if (!trace->started() && !over()) {
    session.stop();
    const std::string said = generator.finish().dump();
    throw std::runtime_error("condition " + condition.name +
                             ": no set-point of the generator arrived; its messages: " + said);
  }

  // Readings at fixed times, as a repeated `top` would take them. This thread does no other work.
  UsageSeries usage(trace->loop_thread(), generator.id());
  HostTime next = host_now();
  const auto step = std::chrono::nanoseconds(std::llround(settings.usage_every_s * 1e9));
  while (!trace->full() && !over()) {
    next = next + step;
    while (host_now() < next && !trace->full() && !over())
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    if (host_now() >= next) usage.sample();
  }
  const bool generator_lasted = generator.running();
  const Json generated = generator.finish();
  session.wait_for_end(kRest);  // lets the arms come to rest before they are held
  session.stop();
  const RunSummary summary = session.finish();
  if (run.progress.stopped()) return {};
  watch.check(name, summary);

  const fs::path file = run.folder / (name + ".npz");
  trace->write(file);
  Json record{{"name", name},
              {"condition", condition.name},
              {"repeat", repeat},
              {"npz", fs::relative(file, run.folder.parent_path()).string()},
              {"arms", arms},
              {"expected_samples", cycles(duration_s)},
              {"samples", trace->count()},
              {"period_s", kArmPeriod},
              {"plant", opened.scene.plant.name},
              {"command_delay_s", opened.scene.plant.command_delay_s},
              {"generator", generated},
              {"generator_lasted", generator_lasted},
              {"usage_columns", UsageSeries::columns()},
              {"usage", usage.rows()},
              {"scene_text", opened.scene.text}};
  if (std::isfinite(bare_us)) record["bare_us"] = std::midpoint(bare_us, bare_math_us(session.models()));
  record.update(of_summary(summary));
  if (watch.extent) record["extent"] = watch.extent->json();
  return record;
}

Json run_delay_check(const PerformanceRun& run, double delay_s) {
  const auto& check = *run.settings.delay_check;
  std::vector<Override> set = check.set;
  set.push_back({.key = "plant.command_delay_s",
                 .value = fmt::format("{}", delay_s),
                 .place = {run.experiment.path, 0}});
  const OpenedScene opened = changed_scene(run.experiment, run.settings.scene, run.settings.plant, set);
  const std::vector<std::string> arms = names_in(opened.scene.arms);

  std::unique_ptr<CommandTrace> trace;
  SessionOptions options{.paced = false, .backend = run.backend, .duration_s = check.duration_s + 1};
  options.observer = [&trace](const CycleRecord& record) { trace->take(record); };
  Session session(opened.scene, opened.registry, std::move(options));
  trace = std::make_unique<CommandTrace>(
      session.modes().layout(), CommandTrace::Options{.lead = 500, .samples = cycles(check.duration_s)});
  session.start();
  const RunSummary summary = session.finish();
  const std::string name = fmt::format("delay_{}", std::llround(delay_s * 1e6));
  const fs::path file = run.folder / (name + ".npz");
  trace->write(file);
  Json record{{"name", name},
              {"npz", fs::relative(file, run.folder.parent_path()).string()},
              {"arms", arms},
              {"period_s", kArmPeriod},
              {"command_delay_s", delay_s}};
  record.update(of_summary(summary));
  return record;
}

}  // namespace multipanda
