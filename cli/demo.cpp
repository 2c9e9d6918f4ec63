#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/report.hpp"
#include "cli/run_arguments.hpp"
#include "cli/run_session.hpp"
#include "common/own_files.hpp"
#include "report/page_script.hpp"
#include "runtime/faulty.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

constexpr const char* kUndisturbed = "right";    // keeps its controllet while the other arm changes
constexpr const char* kFaulty = "left";          // gets the controllet that fails
constexpr const char* kChanged = "left_joints";  // new controllet of the other arm

struct DemoOptions {
  bool fast = false, json = false;
  std::string record = "runs";
  BackendArguments backend;
};

// Checks of the demo on the records, beyond the summary.
struct Trace {
  ArmIndex undisturbed = 0;
  double until_s = 0;
  std::vector<JointArray> torques, positions;  // of the undisturbed arm, up to `until_s`
  double largest_contact_n = 0;
  std::vector<std::uint16_t> last_owners;

  void take(const CycleRecord& record) {
    if (record.t.seconds() < until_s) {
      torques.push_back(record.arms[undisturbed].tau_cmd);
      positions.push_back(record.arms[undisturbed].q);
    }
    last_owners.clear();
    for (const auto& arm : record.arms) {
      last_owners.push_back(arm.owner);
      for (const double f : arm.F_K_W_true) largest_contact_n = std::max(largest_contact_n, std::abs(f));
    }
  }
};

double time_of_switch(const Scene& scene, const std::string& controllet, bool after) {
  bool seen = false;
  for (const auto& event : scene.timeline) {
    if (event.what != TimelineEvent::What::switch_controllets) continue;
    if (seen) return event.at_s;
    seen = std::find(event.activate.begin(), event.activate.end(), controllet) != event.activate.end();
    if (seen && !after) return event.at_s;
  }
  throw std::runtime_error("the demo's scene does not switch to " + controllet);
}

// The same scene without the other arm's switch, up to the next switch: motion of the undisturbed arm if the
// other arm does not change.
Scene without_the_change(Scene scene, double until_s) {
  std::erase_if(scene.timeline, [&](const TimelineEvent& event) {
    return event.at_s >= until_s || event.controllet == kChanged ||
           std::find(event.activate.begin(), event.activate.end(), kChanged) != event.activate.end();
  });
  scene.duration_s = until_s;
  return scene;
}

Trace trace_alone(const Scene& scene, const Registry& registry, ArmIndex arm, double until_s,
                  const BackendOptions& backend) {
  Trace trace{.undisturbed = arm, .until_s = until_s};
  SessionOptions options{.paced = false, .backend = backend};
  options.observer = [&trace](const CycleRecord& record) { trace.take(record); };
  Session session(without_the_change(scene, until_s), registry, std::move(options));
  session.start();
  (void)session.finish();
  return trace;
}

ArmIndex arm_named(const Scene& scene, const std::string& name) {
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    if (scene.arms[i].name == name) return i;
  }
  throw std::runtime_error("the demo's scene has no arm " + name);
}

int run(const DemoOptions& options) {
  const Console console(options.json);
  Registry registry = Registry::with_builtins();
  registry.add(faulty_controllet());
  const Scene scene = load_scene((share_folder() / "config" / "demo.yaml").string(), registry);
  const ArmIndex undisturbed = arm_named(scene, kUndisturbed), faulty = arm_named(scene, kFaulty);
  Trace trace{.undisturbed = undisturbed, .until_s = time_of_switch(scene, kChanged, true)};

  const BackendOptions backend = backend_options(options.backend);
  SessionOptions session_options{.paced = !options.fast, .backend = backend, .record = options.record};
  session_options.observer = [&trace](const CycleRecord& record) { trace.take(record); };
  StopSignals signals(console);
  Session session(scene, registry, std::move(session_options));
  RunSummary summary = run_session(session, signals, console);
  const bool whole = summary.end == RunEnd::duration;

  summary.expected_interventions = {{kFaulty, Intervention::torque_not_finite}};
  console.line("");
  print_summary(summary, console);
  if (whole) {
    // A second run is bit-identical only if the loop sets the time.
    const bool repeatable =
        options.fast || backend.kind == BackendKind::mujoco || backend.kind == BackendKind::as_scene;
    if (backend.kind == BackendKind::fci || !repeatable) {
      console.line("undisturbed: not compared with a second run, which differs in real time");
    } else {
      const Trace alone = trace_alone(scene, registry, undisturbed, trace.until_s, backend);
      const bool same =
          !trace.torques.empty() && trace.torques == alone.torques && trace.positions == alone.positions;
      console.line(fmt::format(
          "undisturbed: the {} arm's torques and positions of {} cycles around the switch to {} are "
          "{} those of a run without it",
          kUndisturbed, trace.torques.size(), kChanged, same ? "bit by bit" : "NOT"));
      if (!same)
        summary.problems.push_back(
            "the arm that kept its controllet was disturbed by the other arm's switch");
    }
    const auto survived = std::find_if(
        summary.interventions.begin(), summary.interventions.end(),
        [](const auto& i) { return i.arm == kFaulty && i.rule == Intervention::torque_not_finite; });
    const bool held = trace.last_owners.at(faulty) == session.modes().find(std::string(kFaulty) + "_hold");
    const bool went_on =
        trace.last_owners.at(undisturbed) == session.modes().find(std::string(kUndisturbed) + "_pose");
    if (survived == summary.interventions.end() || !held || !went_on) {
      summary.problems.push_back(
          "the injected fault did not end as expected: faulty arm held, other arm continuing");
    } else {
      console.line(fmt::format(
          "fault: {} returned NaN at {:.3f} s; the {} arm was held from that cycle on, the {} arm continued",
          survived->controllet, survived->first_s, kFaulty, kUndisturbed));
    }
    if (trace.largest_contact_n > 0) {
      summary.problems.push_back(
          fmt::format("the arms touched something ({:.1f} N)", trace.largest_contact_n));
    }
  } else {
    summary.problems.push_back("the demo was stopped early");
  }
  // The figures above are the result; the report needs plotting packages, which may be missing.
  if (const std::string missing = whole ? missing_page_packages() : ""; !missing.empty()) {
    console.line("no report: " + missing);
  } else if (whole) {
    console.line("writing the report ...");
    summary.report = report_of(summary.log, console, &summary);
    if (summary.report.empty()) summary.problems.push_back("the report could not be made, see above");
  }
  for (const auto& fault : summary.faults()) console.line("failed: " + fault);
  if (!summary.report.empty()) console.line("report: " + summary.report.string());
  if (options.json) fmt::print("{}\n", to_json(summary));
  return summary.success() ? kSuccess : kFailed;
}

}  // namespace

void add_demo(Program& program) {
  auto options = std::make_shared<DemoOptions>();
  CLI::App* command =
      program.add("demo",
                  "Run two arms for 20 s: targets, switches, shared motion and a survived fault; "
                  "ends with a summary and a report",
                  "  multipanda demo              in real time\n"
                  "  multipanda demo --fast       as fast as possible\n"
                  "The scene is config/demo.yaml.");
  command->add_flag("--fast", options->fast, "Run as fast as possible instead of in real time");
  option(command, "--record", options->record, "Folder for the log and the report", named("DIR"), shown);
  add_backend_arguments(command, options->backend);
  json_flag(command, options->json);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
