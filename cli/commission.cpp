#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "commission/tour.hpp"
#include "common/machine.hpp"
#include "common/process.hpp"
#include "report/page_script.hpp"
#include "runtime/backends.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;
using commission::Json;

struct CommissionOptions {
  std::vector<std::string> addresses;
  std::string scene, out = "commission", resume, answers;
  double seconds = 10;
  bool fast = false, no_page = false, json = false;
};

Json read_state(const fs::path& folder) {
  const fs::path file = folder / "commission.json";
  std::ifstream in(file);
  if (!in) throw UsageError("commission: --resume: there is no " + file.string());
  Json state = Json::parse(in, nullptr, false);
  if (state.is_discarded() || !state.contains("steps") || !state.contains("arms"))
    throw UsageError("commission: --resume: " + file.string() + " is not the state file of a tour");
  return state;
}

// Addresses in the scene's order, or ARM=ADDRESS.
BackendOptions backend_of(const CommissionOptions& options, const Scene& scene) {
  BackendOptions backend{.kind = BackendKind::fci};
  if (options.addresses.size() != scene.arms.size()) {
    throw UsageError(fmt::format(
        "commission: scene '{}' has {} arm(s), found {} address(es); give one for each, in the scene's order",
        scene.name, scene.arms.size(), options.addresses.size()));
  }
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const std::string& text = options.addresses[i];
    backend.addresses.push_back(key_and_value(text).value_or(std::pair(scene.arms[i].name, text)));
  }
  return backend;
}

// Values that a resumed tour requires unchanged.
void check_same(const Json& state, const commission::TourSetup& setup) {
  const Json now = commission::new_state(setup);
  if (state["arms"] != now["arms"] || state["scene_text"] != now["scene_text"]) {
    throw UsageError(
        "commission: --resume: the scene or the addresses are not those of the tour that is resumed; begin a "
        "new tour (without --resume), because earlier findings may no longer hold");
  }
}

int run(CommissionOptions options) {
  const Console console(options.json);
  Json state;
  if (!options.resume.empty()) {
    if (!options.addresses.empty() || !options.scene.empty())
      throw UsageError("commission: --resume takes scene and addresses from the tour; omit them");
    state = read_state(options.resume);
    options.out = options.resume;
    options.scene = state["scene"].get<std::string>();
    for (const auto& arm : state["arms"])
      options.addresses.push_back(arm["name"].get<std::string>() + "=" + arm["address"].get<std::string>());
  }
  if (options.addresses.empty())
    throw UsageError("commission: expected the address of each arm, such as 172.16.0.2");
  if (options.scene.empty()) options.scene = options.addresses.size() == 1 ? "one_arm" : "two_arms";
  const fs::path folder = options.out;
  if (options.resume.empty() && fs::exists(folder / "commission.json"))
    throw UsageError("commission: " + folder.string() + " has a tour already: use --resume " +
                     folder.string() + ", or another --out");

  // Before any other thread, which would receive the signals.
  std::atomic<bool> stopped{false};
  const SignalWatch signals([&](int) { stopped = true; });

  OpenedScene opened = open_scene(options.scene);
  refuse_carried_arms(opened.scene, "multipanda commission");
  commission::TourSetup setup{.scene = with_connections(opened.scene, backend_of(options, opened.scene)),
                              .scene_name = options.scene,
                              .addresses = {},
                              .folder = folder,
                              .seconds = options.seconds,
                              .paced = !options.fast};
  for (const auto& arm : setup.scene.arms) {
    if (robot_of(arm).joint_count() != 7)
      throw UsageError("commission: arm '" + arm.name +
                       "' does not have seven joints; the control interface is that of Franka's arms");
    setup.addresses.push_back(arm.fci->address);
  }
  for (const auto& arm : setup.scene.arms) {
    if (arm.loosened.empty()) continue;
    throw UsageError("commission: the scene loosens limits of arm '" + arm.name + "': " +
                     arm.loosened.front() + "; the tour requires the manufacturer's limits: remove this");
  }
  if (state.is_null())
    state = commission::new_state(setup);
  else
    check_same(state, setup);

  Person::Options asking = Person::source(options.answers);
  asking.early = std::ranges::all_of(setup.addresses, is_on_this_computer);
  fs::create_directories(folder);
  const auto tell = [&](const Json& line) {
    if (!options.json) return;
    fmt::print("{}\n", line.dump());
    std::fflush(stdout);
  };
  asking.show = [&](const std::string& id, const std::string& text) {
    console.line(text);
    tell({{"ask", id}, {"text", text}});
  };
  asking.prompt = [&](const std::string& text) { console.raw(text); };
  Person person(std::move(asking));
  commission::Context context{.setup = setup,
                              .person = person,
                              .registry = opened.registry,
                              .say =
                                  [&](const std::string& line) {
                                    console.line(line);
                                    tell({{"say", line}});
                                  },
                              .stopped = [&] { return stopped.load(); },
                              .run = nullptr};
  person.meanwhile([&] {
    context.check_stopped();
    if (context.run) context.run->check();
  });
  const auto end =
      commission::run_tour(context, std::move(state), [&](const commission::Step& step, const Json& result) {
        for (const auto& reading : result["readings"]) console.line("  " + commission::reading_text(reading));
        for (const auto& note : result["notes"]) console.line("  note: " + note.get<std::string>());
        const auto verdict = result["verdict"].get<std::string>();
        console.line(fmt::format("  {}: {}", step.title, verdict));
        if (verdict == "no-go") {
          console.line("  found:    " + result["found"].get<std::string>());
          console.line("  expected: " + result["expected"].get<std::string>());
          console.line("  do:       " + result["remedy"].get<std::string>());
        }
        Json line{{"step", step.id}, {"result", result}};
        line["result"].erase("measured");
        tell(line);
      });
  const bool complete = end.step.empty();
  std::string page;
  try {
    Json all = end.state;
    if (complete) {
      console.line("the same motions on the virtual twin ...");
      commission::measure_twin(setup, opened.registry, all);
      commission::write_state(folder, all);
    }
    if (!options.no_page && missing_page_packages().empty()) page = commission::make_page(folder).string();
  } catch (const std::exception& error) {
    console.line(std::string("no page: ") + error.what());
  }
  std::string left_out;
  for (const auto& [id, result] : end.state["steps"].items()) {
    if (result["verdict"] == "skipped") left_out += " " + id;
  }
  console.line(complete ? "all steps are done: go" + (left_out.empty() ? "" : "; skipped:" + left_out)
                        : fmt::format("ended at '{}' ({}); continue with: multipanda commission --resume {}",
                                      end.step, to_string(end.verdict), folder.string()));
  if (!page.empty()) console.line("page: " + page);
  tell(
      {{"end", {{"verdict", complete ? "go" : to_string(end.verdict)}, {"step", end.step}, {"page", page}}}});
  return complete ? kSuccess : kFailed;
}

}  // namespace

void add_commission(Program& program) {
  auto options = std::make_shared<CommissionOptions>();
  CLI::App* command =
      program.add("commission",
                  "The first hour with real arms, step by step: each step says what will move, waits for a "
                  "key, and has limits",
                  "  multipanda commission 172.16.0.2 --scene my/scene.yaml\n"
                  "  multipanda commission 172.16.0.2 172.16.0.3 --scene two_arms --out first_day\n"
                  "  multipanda commission --resume first_day\n"
                  "Without a terminal every answer must come from --answers. "
                  "docs/commission.md lists steps and limits.");
  option(command, "addresses", options->addresses,
         "Address of each arm, in the scene's order, or ARM=ADDRESS", named("ADDRESS"));
  option(command, "--scene", options->scene,
         "The scene of these arms: models, bases, tools (default: one_arm or two_arms)");
  option(command, "--out", options->out, "Folder of state and page (default: commission)", named("DIR"));
  option(command, "--resume", options->resume,
         "Resume the tour of this folder; safety-related steps are repeated", named("DIR"));
  option(command, "--answers", options->answers,
         "File or pipe of lines 'QUESTION: answer' in place of a terminal; '-': standard input",
         named("FILE"));
  option(command, "--seconds", options->seconds,
         "Duration of each measurement of computer and network [s] (default 10)", within(0.1, 3600.0));
  command->add_flag("--fast", options->fast,
                    "For virtual arms in lock-step on this computer: as fast as they run");
  command->add_flag("--no-page", options->no_page, "Do not draw the page");
  command->add_flag("--json", options->json,
                    "One JSON line per question and step to standard output, messages to standard error");
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
