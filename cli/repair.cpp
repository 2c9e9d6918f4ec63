#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/report.hpp"
#include "logs/export.hpp"

namespace multipanda::cli {

void add_repair(Program& program) {
  auto path = std::make_shared<std::string>();
  CLI::App* command = program.add(
      "repair", "Add the missing index and footer to the log of a killed run; leave out what cannot be read",
      "  multipanda repair runs/20260102_120000_two_arms/log.mcap");
  option(command, "log", *path, "Log file or folder of its run", required, named("LOG"));
  program.on(command, [path] {
    const std::filesystem::path log = find_log(*path);
    const RepairResult result = repair_log(log);
    if (result.was_complete) {
      fmt::print("{}: complete, {} messages; nothing changed\n", log.string(), result.messages);
    } else {
      fmt::print("{}: repaired, {} messages; {} unreadable chunks and {} bytes at the end were dropped\n",
                 log.string(), result.messages, result.chunks_dropped, result.bytes_dropped);
    }
    return kSuccess;
  });
}

}  // namespace multipanda::cli
