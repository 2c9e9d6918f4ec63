#include <csignal>
#include <cstdio>
#include <exception>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "scene/names.hpp"

namespace multipanda::cli {
namespace {

std::vector<std::string> words_of(const CLI::App& app) {
  std::vector<std::string> words;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    words.push_back(command->get_name());
  }
  return words;
}

std::vector<std::string> options_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const auto& name : option->get_lnames()) names.push_back(fmt::format("--{}", name));
  }
  return names;
}

// The sub-command that was called, however deep; the program itself if none was.
const CLI::App* innermost(const CLI::App* app) {
  while (!app->get_subcommands().empty()) app = app->get_subcommands().front();
  return app;
}

int wrong_use(const CLI::App& program, const CLI::ParseError& error) {
  const CLI::App* command = innermost(&program);
  std::string message = error.what();
  const std::vector<std::string> extras = command->remaining();
  const auto children = words_of(*command);
  if (!extras.empty()) {
    const std::string& word = extras.front();
    if (word.starts_with("-")) {
      message = fmt::format("there is no option '{}'{}", word,
                            name_hint(word, options_of(*command), "there are no options"));
    } else if (!children.empty()) {
      message =
          fmt::format("there is no command '{}'{}", word, name_hint(word, children, "there are no commands"));
    } else {
      message = fmt::format("'{}' is one word too many", word);
    }
  } else if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr && !children.empty()) {
    message = fmt::format("a command is expected: {}", joined(children));
  }
  std::string path = command == &program ? std::string() : fmt::format(" {}", command->get_name());
  for (const CLI::App* at = command->get_parent(); at != nullptr && at != &program; at = at->get_parent()) {
    path = fmt::format(" {}{}", at->get_name(), path);
  }
  fmt::print(stderr, "multipanda{}: {}\nTry: multipanda{} --help\n", path, message, path);
  return kUsage;
}

int run(int argc, char** argv) {
  Program program;
  program.app.name("multipanda");
  program.app.description(
      "multipanda: any number of torque-controlled arms from one process at 1 kHz.\n"
      "Every command has its own --help with examples.");
  program.app.set_version_flag("--version", MULTIPANDA_VERSION);
  program.app.require_subcommand(1);
  program.app.footer(
      "Exit codes: 0 success; 1 it was tried and did not go as asked; 2 wrong words or a refused scene.\n"
      "Examples:\n"
      "  multipanda demo\n"
      "  multipanda run two_arms --seconds 10 --record runs\n"
      "  multipanda list scenes");
  for (const auto add : {add_demo,        add_run,
                         add_move,        add_ctl,
                         add_check,       add_list,
                         add_report,      add_repair,
                         add_export,      add_experiment,
                         add_compare,     add_excite,
                         add_refine,      add_generate,
                         add_identify,    add_predict,
                         add_fit,         add_via_points,
                         add_virtual_arm, add_bench,
                         add_doctor,      add_communication_test,
                         add_docs}) {
    add(program);
  }
  try {
    program.app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return program.app.exit(error);  // --help, --version
    return wrong_use(program.app, error);
  }
  return program.exit_code;
}

}  // namespace
}  // namespace multipanda::cli

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);  // a reader that goes away must not take the arms' loop with it
  try {
    return multipanda::cli::run(argc, argv);
  } catch (const std::invalid_argument& error) {
    fmt::print(stderr, "multipanda: {}\n", error.what());
    return multipanda::cli::kUsage;
  } catch (const std::exception& error) {
    fmt::print(stderr, "multipanda: {}\n", error.what());
    return multipanda::cli::kFailed;
  }
}
