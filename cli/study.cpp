#include "experiments/study/study.hpp"

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "common/own_files.hpp"
#include "experiments/processes.hpp"
#include "experiments/study/scene_run.hpp"
#include "report/page_script.hpp"

// `multipanda study`: this program reads the file and executes single runs (--worker); Python, which can use
// clusters, schedules them (python/multipanda/study_command.py).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct StudyArguments {
  std::string file, out, executor = "local", page;
  std::size_t workers = 0, batch = 0;
  bool json = false, no_page = false, any_machine = false, plan = false, worker = false;
};

// Prints a line with the version. Then each line of standard input is a run, and each line of output its
// result, until the input ends.
int serve() {
  fmt::print("{}\n", Json{{"version", MULTIPANDA_VERSION}}.dump());
  std::fflush(stdout);
  for (std::string line; std::getline(std::cin, line);) {
    Json answer;
    try {
      answer = run_scene(scene_run_from(Json::parse(line)));
    } catch (const std::exception& error) {
      answer = {{"error", error.what()}};
    }
    fmt::print("{}\n", answer.dump(-1, ' ', false, Json::error_handler_t::replace));
    std::fflush(stdout);
  }
  return kSuccess;
}

int run(const StudyArguments& arguments) {
  if (arguments.worker) {
    // Before the first line of output: the identity of results contains every library (study_identity.py).
    (void)from_own_library("libmultipanda_mujoco.so", "multipanda_engine");
    return serve();
  }
  if (!arguments.page.empty()) {
    PageScript("experiments/study/study_page.py", "the page").run({arguments.page});
    return kSuccess;
  }
  if (arguments.file.empty()) throw UsageError("study: expected a file");
  if (arguments.plan) {
    fmt::print("{}\n", to_json(load_study(arguments.file)).dump());
    return kSuccess;
  }
  const std::string python = page_python().string();
  const std::string script = (share_folder() / "experiments" / "study" / "study.py").string();
  if (!fs::exists(python) || !fs::exists(script))
    throw std::runtime_error("study needs " + python + " and " + script + "; " + page_packages_cure());
  std::vector<std::string> words{
      python, "-E", "-B", script, arguments.file, "--executor", arguments.executor};
  const auto add = [&](const char* name, const std::string& value) {
    words.insert(words.end(), {std::string(name), value});
  };
  if (!arguments.out.empty()) add("--out", arguments.out);
  if (arguments.workers > 0) add("--workers", std::to_string(arguments.workers));
  if (arguments.batch > 0) add("--batch", std::to_string(arguments.batch));
  if (arguments.json) words.emplace_back("--json");
  if (arguments.no_page) words.emplace_back("--no-page");
  if (arguments.any_machine) words.emplace_back("--any-machine");
  setenv("MULTIPANDA_PROGRAM", own_program().c_str(), 1);
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  execv(python.c_str(), argv.data());
  throw std::runtime_error("cannot start " + python);
}

}  // namespace

void add_study(Program& program) {
  auto arguments = std::make_shared<StudyArguments>();
  CLI::App* command = program.add(
      "study",
      "Run a scene, an experiment or a program many times: every combination of choices with every seed",
      "  multipanda study stiffness.yaml                     on all cores; the same command resumes it\n"
      "  multipanda study stiffness.yaml --executor dask:10.0.0.5:8786\n"
      "  multipanda study stiffness.yaml --executor slurm --workers 16\n"
      "Runs that are done are skipped. Fails (exit code 1) if a run has no result.");
  option(command, "file", arguments->file, "Study file (docs/studies.md)", named("FILE"));
  option(command, "--out", arguments->out, "Folder of the results (default: runs/study_NAME)", named("DIR"));
  option(command, "--executor", arguments->executor, "local, dask:ADDRESS of a scheduler, or slurm", shown);
  option(command, "--workers", arguments->workers,
         "Runs at once (default: one per core; dask: one per thread of its workers; slurm: 4 jobs)",
         within(1, 100000));
  option(command, "--batch", arguments->batch,
         "Runs per batch (default: as many as take about 2 s; slurm: a quarter of a worker's share)",
         within(1, 1000000));
  command->add_flag("--any-machine", arguments->any_machine,
                    "Accept results of different processors and libraries, which differ in the last bits");
  command->add_flag("--no-page", arguments->no_page, "Make no page, only table.csv");
  json_flag(command, arguments->json);
  option(command, "--page", arguments->page, "Make the page of a folder of results again", named("DIR"));
  command->add_flag("--plan", arguments->plan, "Print the checked file as JSON, and run nothing");
  command->add_flag("--worker", arguments->worker,
                    "Read runs from standard input, one per line; for programs");
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
