#include <cerrno>
#include <cstring>
#include <filesystem>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/program.hpp"

namespace multipanda::cli {
namespace {

// Replaces this process by the benchmark program, which counts allocations and needs the machine
// for itself.
int run(const std::vector<std::string>& arguments) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string program = (self.parent_path() / "multipanda_bench").string();
  std::vector<std::string> all{program};
  all.insert(all.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (auto& argument : all) argv.push_back(argument.data());
  argv.push_back(nullptr);
  execv(program.c_str(), argv.data());
  fmt::print(stderr,
             "multipanda bench: {}: {}; build it in the source tree with ./multipanda setup; wheel and .deb "
             "do not have it\n",
             program, std::strerror(errno));
  return kFailed;
}

}  // namespace

void add_bench(Program& program) {
  CLI::App* command =
      program.add("bench", "Measure the loop, the controllets, switching and the simulation",
                  "  multipanda bench\n"
                  "  multipanda bench --json > bench.json     one object; within 45 s\n"
                  "All options are passed to the benchmark program; see multipanda bench -- --help");
  command->allow_extras();
  command->prefix_command();
  program.on(command, [command] { return run(command->remaining()); });
}

}  // namespace multipanda::cli
