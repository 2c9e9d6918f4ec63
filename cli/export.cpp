#include "logs/export.hpp"

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/report.hpp"

namespace multipanda::cli {
namespace {

struct ExportOptions {
  std::string log, out;
  bool csv = false, npz = false;
};

int run(const ExportOptions& options) {
  namespace fs = std::filesystem;
  if (!options.csv && !options.npz) throw UsageError("export: name a format: --csv or --npz");
  const fs::path log = find_log(options.log);
  fs::path out = options.out;
  if (out.empty()) out = options.csv ? log.parent_path() / "csv" : fs::path(log).replace_extension(".npz");
  const ExportResult result = options.csv ? export_csv(log, out) : export_npz(log, out);
  for (const auto& note : result.notes) fmt::print(stderr, "note: {}\n", note);
  for (const auto& file : result.files) fmt::print("{}\n", file.string());
  return kSuccess;
}

}  // namespace

void add_export(Program& program) {
  auto options = std::make_shared<ExportOptions>();
  CLI::App* command =
      program.add("export", "Writes a log as CSV tables or as one archive for numpy",
                  "  multipanda export runs/20260102_120000_two_arms/log.mcap --csv --out tables\n"
                  "  multipanda export runs --npz                      of the newest run in runs");
  command->add_option("log", options->log, "Log file, or the folder of its run")
      ->required()
      ->type_name("LOG");
  CLI::Option* csv = command->add_flag("--csv", options->csv,
                                       "One table per topic, in a folder (default: csv beside the log)");
  command->add_flag("--npz", options->npz, "One archive for numpy.load() (default: beside the log)")
      ->excludes(csv);
  command->add_option("--out", options->out, "Folder for --csv, file for --npz")->type_name("PATH");
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
