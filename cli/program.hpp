#pragma once

#include <cstdio>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

// The command line. Each command has its own file, with a function add_<command>(program).
namespace multipanda::cli {

// Human-readable output: standard output, or standard error if standard output carries JSON (--json).
class Console {
 public:
  explicit Console(bool json);

  bool is_terminal() const { return terminal_; }  // supports redrawing
  bool has_color() const { return color_; }       // a terminal, and NO_COLOR is not set
  std::size_t width() const;                      // current number of columns
  std::size_t height() const;                     // current number of lines

  void line(const std::string& text) const;  // with a newline; flushed
  void raw(const std::string& text) const;   // unchanged, in one write; flushed

 private:
  std::FILE* stream_;
  bool terminal_ = false, color_ = false;
};

// Exit codes of every command (docs/command_line.md).
enum ExitCode : int {
  kSuccess = 0,
  kFailed = 1,  // the run failed
  kUsage = 2,   // invalid arguments or a refused scene: nothing was run
};

// Usage error that a command detects while it runs. what() states what was expected.
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

// An option of a command, and what it is beyond its name, its variable and its help: named("FILE"),
// within(0.0, 1.0), one_of({"a", "b"}), required ...
template <typename Value, typename... How>
CLI::Option* option(CLI::App* command, const std::string& name, Value& value, const std::string& help,
                    const How&... how) {
  CLI::Option* made = command->add_option(name, value, help);
  (how(made), ...);
  return made;
}
inline auto named(std::string value) {
  return [value](CLI::Option* o) { o->type_name(value); };
}
inline auto within(auto low, auto high) {
  return [low, high](CLI::Option* o) { o->check(CLI::Range(low, high)); };
}
inline auto one_of(std::vector<std::string> words) {
  return [words](CLI::Option* o) { o->check(CLI::IsMember(words)); };
}
inline auto expecting(int count) {
  return [count](CLI::Option* o) { o->expected(count); };
}
inline void required(CLI::Option* o) { o->required(); }
inline void shown(CLI::Option* o) { o->capture_default_str(); }  // the default, in the help
inline void repeated(CLI::Option* o) { o->take_all(); }
inline void by_commas(CLI::Option* o) { o->delimiter(','); }
inline void positive(CLI::Option* o) { o->check(CLI::PositiveNumber); }
inline void existing_file(CLI::Option* o) { o->check(CLI::ExistingFile); }

// Options of many commands.
CLI::Option* scene_option(CLI::App* command, std::string& scene);
void json_flag(CLI::App* command, bool& json);

// The two parts of "KEY=VALUE", split at the first "="; nothing if one of them is empty.
std::optional<std::pair<std::string, std::string>> key_and_value(const std::string& text);

struct ProgramWords {
  std::string name, description, footer;
};
using AddCommand = void (*)(Program&);

// A program's main(): parses the arguments, runs the command and returns its exit code.
int run_program(int argc, char** argv, const ProgramWords& words, std::initializer_list<AddCommand> commands);

// Replaces this process by another program of the same folder. Returns an exit code if it cannot.
int become(const char* program, char** argv);

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
void add_bridge(Program& program);
void add_new(Program& program);
void add_arm(Program& program);
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
void add_observe(Program& program);
void add_fit(Program& program);
void add_via_points(Program& program);
void add_soak(Program& program);
void add_study(Program& program);
void add_virtual_arm(Program& program);

}  // namespace multipanda::cli
