#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

// The command line. Each command has a file of its own, with a function add_<command>(program).
namespace multipanda::cli {

// Exit codes of every command (docs/command_line.md).
enum ExitCode : int {
  kSuccess = 0,
  kFailed = 1,  // the run failed
  kUsage = 2,   // invalid arguments or a refused scene: nothing was tried
};

// Wrong usage that a command detects while it runs. what() states what was expected.
struct UsageError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

struct Program {
  CLI::App app;
  int exit_code = kSuccess;

  // Adds a command with its examples. on() sets the function that runs it and returns the exit code.
  CLI::App* add(const std::string& argument, const std::string& what, const std::string& examples);
  template <typename Run>
  void on(CLI::App* command, Run run) {
    command->callback([this, run] { exit_code = run(); });
  }
};

void add_run(Program& program);
void add_move(Program& program);
void add_demo(Program& program);
void add_law(Program& program);
void add_list(Program& program);
void add_check(Program& program);
void add_cockpit(Program& program);
void add_report(Program& program);
void add_repair(Program& program);
void add_export(Program& program);
void add_bench(Program& program);
void add_docs(Program& program);
void add_experiment(Program& program);
void add_compare(Program& program);
void add_excite(Program& program);
void add_refine(Program& program);
void add_ctl(Program& program);
void add_commission(Program& program);
void add_communication_test(Program& program);
void add_doctor(Program& program);
void add_generate(Program& program);
void add_identify(Program& program);
void add_predict(Program& program);
void add_fit(Program& program);
void add_via_points(Program& program);
void add_soak(Program& program);
void add_study(Program& program);
void add_virtual_arm(Program& program);

}  // namespace multipanda::cli
