#include "cli/report.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/run_arguments.hpp"
#include "logs/recorder.hpp"
#include "report/report.hpp"
#include "runtime/faulty.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> logs_in(const fs::path& directory) {
  std::vector<fs::path> logs;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(directory, error)) {
    if (entry.is_regular_file(error) && entry.path().extension() == ".mcap") logs.push_back(entry.path());
  }
  std::sort(logs.begin(), logs.end());
  return logs;
}

}  // namespace

fs::path find_log(const fs::path& directory) {
  std::error_code error;
  if (fs::is_regular_file(directory, error) || fs::exists(directory / "metadata.yaml", error))
    return directory;
  if (!fs::is_directory(directory, error)) {
    throw UsageError(fmt::format("there is no folder or log {}; name one made by 'multipanda run --record'",
                                 directory.string()));
  }
  if (const auto logs = logs_in(directory); !logs.empty()) return logs.front();
  fs::path newest;
  fs::file_time_type newest_time;
  for (const auto& entry : fs::directory_iterator(directory, error)) {
    if (!entry.is_directory(error)) continue;
    for (const auto& log : logs_in(entry.path())) {
      const auto time = fs::last_write_time(log, error);
      if (newest.empty() || time > newest_time) {
        newest = log;
        newest_time = time;
      }
    }
  }
  if (newest.empty()) {
    throw UsageError(
        fmt::format("there is no log (*.mcap) in {} or its folders; make one with 'multipanda run SCENE "
                    "--record {}'",
                    directory.string(), directory.string()));
  }
  return newest;
}

fs::path own_log(const fs::path& file) {
  if (is_own_log(file)) return file;
  try {
    const auto logs = read_measured(file, {.needs_dynamics = false});
    const fs::path log = make_run_directory("runs", file.stem().string()) / "log.mcap";
    write_own_log(logs, log);
    for (const MeasuredLog& one : logs) {
      for (const std::string& warning : one.warnings) fmt::print(stderr, "warning: {}\n", warning);
    }
    return log;
  } catch (const LogRefused& error) {
    throw UsageError(error.what());
  }
}

fs::path report_of(const fs::path& log, const Console& console, const RunSummary* run) {
  ReportOptions options;
  options.controllets = {faulty_controllet()};  // for the demo's scene
  if (run != nullptr) {
    for (const auto& step : run->thread)
      options.info["thread: " + step.what] = step.done ? "done" : "not done: " + step.reason;
  }
  try {
    const ReportResult result = make_report(log, options);
    for (const auto& note : result.notes) console.line("report: " + note);
    return result.page;
  } catch (const std::runtime_error& error) {
    console.line(fmt::format("no report: {}", error.what()));
    return {};
  }
}

void add_report(Program& program) {
  struct Arguments {
    std::string directory;
    CockpitArguments cockpit;
    bool until_input_ends = false;
  };
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      program.add("report", "Make an HTML report of a recorded run",
                  "  multipanda report runs                            of the newest run in runs\n"
                  "  multipanda report runs/20260102_120000_two_arms   of this run\n"
                  "  multipanda report measured.npz                    of another program's recording\n"
                  "  multipanda report runs --cockpit                  shows it, as multipanda cockpit does");
  option(command, "directory", arguments->directory,
         "Log, folder of a run, or folder of runs (the newest is used)", required, named("DIR"));
  add_cockpit_arguments(
      command, arguments->cockpit,
      "Show the log in a browser on this computer instead, until Ctrl-C, as multipanda cockpit "
      "does, at a port of 127.0.0.1");
  command
      ->add_flag(
          "--until-input-ends", arguments->until_input_ends,
          "With --cockpit: end when standard input closes, as when the program that started it has ended")
      ->needs("--cockpit");
  program.on(command, [arguments]() -> int {
    const fs::path log = own_log(find_log(arguments->directory));
    if (arguments->cockpit.asked)
      return show_logs({log}, arguments->cockpit.port, arguments->until_input_ends);
    const fs::path report = report_of(log, Console(true));
    if (report.empty()) return kFailed;
    fmt::print("{}\n", report.string());
    return kSuccess;
  });
}

}  // namespace multipanda::cli
