#include <cerrno>
#include <cstring>
#include <filesystem>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/program.hpp"

namespace multipanda::cli {
namespace {

// The benchmarks are a program of their own, beside this one: they count allocations and need the machine
// for themselves. It takes our place.
int run(const std::vector<std::string>& words) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string program = (self.parent_path() / "multipanda_bench").string();
  std::vector<std::string> arguments{program};
  arguments.insert(arguments.end(), words.begin(), words.end());
  std::vector<char*> argv;
  for (auto& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  execv(program.c_str(), argv.data());
  fmt::print(stderr, "multipanda bench: {}: {}; build it with ./multipanda setup\n", program,
             std::strerror(errno));
  return kFailed;
}

}  // namespace

void add_bench(Program& program) {
  CLI::App* command = program.add("bench", "Measures the loop, the controllets, switching and the simulation",
                                  "  multipanda bench\n"
                                  "  multipanda bench --json > bench.json     one object; within 45 s\n"
                                  "All options go to the benchmark program; see multipanda bench -- --help");
  command->allow_extras();
  command->prefix_command();
  program.on(command, [command] { return run(command->remaining()); });
}

}  // namespace multipanda::cli
