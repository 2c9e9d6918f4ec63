#include <csignal>
#include <cstdio>
#include <exception>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "support/spelling.hpp"

namespace multipanda::cli {
namespace {

std::vector<std::string> names_of_commands(const CLI::App& app) {
  std::vector<std::string> arguments;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    arguments.push_back(command->get_name());
  }
  return arguments;
}

std::vector<std::string> options_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const auto& name : option->get_lnames()) names.push_back(fmt::format("--{}", name));
  }
  return names;
}

// The innermost command on the command line, or the program itself.
const CLI::App* innermost(const CLI::App* app) {
  while (!app->get_subcommands().empty()) app = app->get_subcommands().front();
  return app;
}

int wrong_use(const CLI::App& program, const CLI::ParseError& error) {
  const CLI::App* command = innermost(&program);
  std::string message = error.what();
  const std::vector<std::string> extras = command->remaining();
  const auto children = names_of_commands(*command);
  if (!extras.empty()) {
    const std::string& argument = extras.front();
    if (argument.starts_with("-")) {
      message = fmt::format("unknown option '{}'{}", argument,
                            name_hint(argument, options_of(*command), "there are no options"));
    } else if (!children.empty()) {
      message = fmt::format("unknown command '{}'{}", argument,
                            name_hint(argument, children, "there are no commands"));
    } else {
      message = fmt::format("unexpected argument '{}'", argument);
    }
  } else if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr && !children.empty()) {
    message = fmt::format("expected a command: {}", joined(children));
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
      "multipanda controls any number of torque-controlled arms from one process at 1 kHz.\n"
      "Every command has its own --help with examples.");
  program.app.set_version_flag("--version", MULTIPANDA_VERSION);
  program.app.require_subcommand(1);
  program.app.footer(
      "Exit codes: 0 success; 1 run failed; 2 invalid arguments or a refused scene.\n"
      "Examples:\n"
      "  multipanda demo\n"
      "  multipanda run two_arms --seconds 10 --record runs\n"
      "  multipanda list scenes");
  for (const auto add :
       {add_demo,    add_run,        add_move,        add_ctl,      add_check,    add_law,
        add_list,    add_cockpit,    add_report,      add_repair,   add_export,   add_experiment,
        add_compare, add_excite,     add_refine,      add_generate, add_identify, add_predict,
        add_fit,     add_via_points, add_virtual_arm, add_bench,    add_doctor,   add_communication_test,
        add_soak,    add_study,      add_commission,  add_docs}) {
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
  std::signal(SIGPIPE, SIG_IGN);  // a closed output pipe must not end the control loop
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
