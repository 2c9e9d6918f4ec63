#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

// The command line: one file per sub-command, each adds itself with add_<word>(program).
namespace multipanda::cli {

// How every sub-command ends (docs/command_line.md).
enum ExitCode : int {
  kSuccess = 0,
  kFailed = 1,  // it was tried, and did not go as asked
  kUsage = 2,   // wrong words, or a scene that is refused: nothing was tried
};

// Wrong use that only shows when a sub-command looks closer. what() says what was expected.
struct UsageError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

struct Program {
  CLI::App app;
  int exit_code = kSuccess;

  // A sub-command with its examples; `run` (returning an exit code) is called after the words were read.
  CLI::App* add(const std::string& word, const std::string& what, const std::string& examples);
  template <typename Run>
  void on(CLI::App* command, Run run) {
    command->callback([this, run] { exit_code = run(); });
  }
};

void add_run(Program& program);
void add_move(Program& program);
void add_demo(Program& program);
void add_list(Program& program);
void add_check(Program& program);
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
void add_communication_test(Program& program);
void add_doctor(Program& program);
void add_generate(Program& program);
void add_identify(Program& program);
void add_predict(Program& program);
void add_fit(Program& program);
void add_via_points(Program& program);
void add_virtual_arm(Program& program);

}  // namespace multipanda::cli
