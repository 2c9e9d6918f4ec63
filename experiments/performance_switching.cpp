#include <algorithm>
#include <chrono>
#include <cstring>
#include <random>
#include <thread>

#include <fmt/format.h>

#include "experiments/arm_steps.hpp"
#include "experiments/performance_runs.hpp"
#include "runtime/command_trace.hpp"

namespace multipanda {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kLead = 500;                       // cycles before the first request
constexpr double kPauseLow = 0.005, kPauseHigh = 0.015;  // between two requests [s]
constexpr std::size_t kCyclesPerTrial = 60;              // kept: pause, answer and delays of the machine

constexpr double kAnswerPatience = 10;  // [s]

struct Trial {
  std::string kind, to;
  Answer answer;
  HostTime queued;  // time at which the request was queued for the loop
};

// As MultimodeController::ask(), but the delay of the loop counts from the queue: the requesting thread may
// lose its core between time stamp and queue.
Answer ask_and_note(MultimodeController& modes, const Request& request, HostTime& queued) {
  Answer answer;
  std::uint64_t ticket = 0;
  answer.received = host_now();
  answer.verdict = modes.post(std::span(&request, 1), ticket);
  queued = host_now();
  if (!answer.accepted()) return answer;
  while (!modes.poll(ticket, answer)) {
    if (seconds(host_now() - queued) > kAnswerPatience) {
      answer.verdict = Verdict::timeout;
      break;
    }
    std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
  return answer;
}

ArmIndex arm_named(const MultimodeController& modes, const std::string& name) {
  for (ArmIndex arm = 0; arm < modes.arm_count(); ++arm) {
    if (modes.arm_name(arm) == name) return arm;
  }
  throw std::invalid_argument("switching: the scene has no arm '" + name + "'");
}

InstanceIndex instance_named(const MultimodeController& modes, const std::string& name) {
  const InstanceIndex instance = modes.find(name);
  if (instance == kNoInstance)
    throw std::invalid_argument("switching: the scene has no controllet '" + name + "'");
  return instance;
}

// Cycles that began between the request and the cycle that took it; 0 if the next cycle took it.
std::int64_t cycles_late(const CommandTrace& trace, const Trial& trial) {
  std::size_t i = 0;
  while (i < trace.count() && trace.sample(i).start_ns < trial.queued.ns) ++i;
  if (i == trace.count()) return 0;  // taken within the last recorded cycle
  return static_cast<std::int64_t>(trial.answer.cycle) - static_cast<std::int64_t>(trace.sample(i).cycle);
}

std::unique_ptr<CommandTrace> trace_of(Session& session, std::size_t samples) {
  return std::make_unique<CommandTrace>(session.modes().layout(),
                                        CommandTrace::Options{.lead = 0, .samples = samples});
}

// Number of cycles up to `last` in which two histories of the arm differ in any bit of its
// measurements or commands.
std::size_t different_cycles(const CommandTrace& a, const CommandTrace& b, ArmIndex arm, std::uint64_t last,
                             std::size_t& compared) {
  std::size_t different = 0, j = 0;
  for (std::size_t i = 0; i < a.count() && a.sample(i).cycle <= last; ++i) {
    while (j < b.count() && b.sample(j).cycle < a.sample(i).cycle) ++j;
    if (j == b.count()) break;
    if (b.sample(j).cycle != a.sample(i).cycle) continue;
    ++compared;
    const auto &x = a.arm(i, arm), &y = b.arm(j, arm);
    different += std::memcmp(x.q, y.q, sizeof(x.q)) != 0 ||
                 std::memcmp(x.tau_J, y.tau_J, sizeof(x.tau_J)) != 0 ||
                 std::memcmp(x.tau_J_d, y.tau_J_d, sizeof(x.tau_J_d)) != 0 ||
                 std::memcmp(x.tau_cmd, y.tau_cmd, sizeof(x.tau_cmd)) != 0;
  }
  return different;
}

}  // namespace

Json run_switching(const PerformanceRun& run) {
  const auto& switching = *run.settings.switching;
  const OpenedScene opened = changed_scene(run.experiment, switching.scene, run.settings.plant, {});
  const std::size_t samples = kLead + 2 * switching.trials * kCyclesPerTrial;

  std::unique_ptr<CommandTrace> trace, undisturbed;
  RunWatch watch;
  std::vector<Trial> trials;
  ArmIndex bystander = 0;
  RunSummary summary;
  {
    SessionOptions options{.paced = true, .backend = run.backend, .duration_s = 0.0};
    options.observer = [&trace, &watch](const CycleRecord& record) {
      trace->take(record);
      watch.take(record);
    };
    if (run.viewer != nullptr) run.viewer->prepare(options);
    Session session(opened.scene, opened.registry, std::move(options));
    trace = trace_of(session, samples);
    if (run.rehearsal) watch.extent.emplace(session.scene(), session.models());
    if (run.on_arms()) watch.arms.emplace(session.scene(), session.layout(), session.models(), run.expected);
    MultimodeController& modes = session.modes();
    bystander = arm_named(modes, switching.bystander);
    const InstanceSet sets[] = {bit(instance_named(modes, switching.controllets[0])),
                                bit(instance_named(modes, switching.controllets[1]))};
    const InstanceIndex owner = instance_named(modes, switching.controllet);
    const auto feature = modes.instance(owner).find_feature(switching.feature);
    if (feature >= modes.instance(owner).feature_count())
      throw std::invalid_argument("switching: " + switching.controllet + " has no feature '" +
                                  switching.feature + "'");
    const Viewed viewed(run.viewer, session);
    if (run.progress.stopped()) return {};
    session.start();
    const auto running = [&] {
      return !watch.stopped(session) && !run.progress.stopped() && !session.wait_for_end(0);
    };
    while (trace->count() < kLead && running() && !session.wait_for_end(0.01)) {
    }
    std::mt19937_64 random(run.experiment.seed);
    std::uniform_real_distribution<double> pause(kPauseLow, kPauseHigh);
    const auto ask = [&](const std::string& kind, const std::string& to, const Request& request) {
      std::this_thread::sleep_for(std::chrono::duration<double>(pause(random)));
      Trial& trial = trials.emplace_back(Trial{.kind = kind, .to = to, .answer = {}, .queued = {}});
      trial.answer = ask_and_note(modes, request, trial.queued);
    };
    // The feature first: its controllet is active from the start.
    for (std::size_t i = 0; i < switching.trials && running(); ++i) {
      const bool on = i % 2 != 0;  // the feature is on at the start of the run
      ask("feature", switching.feature + (on ? " on" : " off"),
          {.kind = Request::Kind::set_feature,
           .instance = owner,
           .index = static_cast<std::uint16_t>(feature),
           .on = on});
    }
    for (std::size_t i = 0; i < switching.trials && running(); ++i)
      ask("controllet", switching.controllets[(i + 1) % 2], {.activate = sets[(i + 1) % 2]});
    session.stop();
    summary = session.finish();
  }
  if (run.progress.stopped()) return {};
  watch.check("switching", summary);
  if (!run.on_arms() && !run.rehearsal) {  // arms cannot repeat a run bit for bit
    const double seconds = 1e-3 * static_cast<double>(std::min(trace->count(), samples));
    SessionOptions options{.paced = false, .backend = run.backend, .duration_s = seconds};
    options.observer = [&undisturbed](const CycleRecord& record) { undisturbed->take(record); };
    Session session(opened.scene, opened.registry, std::move(options));
    undisturbed = trace_of(session, samples);
    session.start();
    (void)session.finish();
  }
  // The end of the run, when all arms go to hold, affects the bystander and is not compared.
  const std::uint64_t last = trials.empty() ? 0 : trials.back().answer.cycle;
  std::size_t compared = 0;
  const std::size_t different =
      undisturbed ? different_cycles(*trace, *undisturbed, bystander, last, compared) : 0;

  Json list = Json::array();
  for (const auto& trial : trials) {
    const Answer& a = trial.answer;
    Json entry{{"kind", trial.kind},
               {"to", trial.to},
               {"accepted", a.accepted()},
               {"verdict", to_string(a.verdict)}};
    if (a.accepted()) {
      const auto us = [](std::chrono::nanoseconds t) { return static_cast<double>(t.count()) * 1e-3; };
      entry["cycles_late"] = std::max<std::int64_t>(cycles_late(*trace, trial), 0);
      entry["received_to_taken_us"] = us(a.taken - a.received);
      entry["taken_to_first_torque_us"] = us(a.first_torque - a.taken);
      entry["torque_step_nm"] = *std::max_element(a.step_sent.begin(), a.step_sent.end());
    }
    list.push_back(std::move(entry));
  }
  return {{"extent", watch.extent ? watch.extent->json() : Json::array()},
          {"trials", switching.trials},
          {"controllets", switching.controllets},
          {"controllet", switching.controllet},
          {"feature", switching.feature},
          {"bystander", switching.bystander},
          {"bystander_cycles", compared},
          {"bystander_different", different},
          {"overruns", summary.overruns},
          {"faults", summary.faults()},
          {"scene_text", opened.scene.text},
          {"list", list}};
}

}  // namespace multipanda
