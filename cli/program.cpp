#include "cli/program.hpp"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <string_view>
#include <sys/ioctl.h>
#include <unistd.h>

#include <fmt/format.h>

#include "common/text.hpp"

namespace multipanda::cli {

Console::Console(bool as_json) : stream_(as_json ? stderr : stdout) {
  const char* term = std::getenv("TERM");
  terminal_ = isatty(fileno(stream_)) != 0 && term != nullptr && std::string_view(term) != "dumb";
  const char* no_color = std::getenv("NO_COLOR");
  color_ = terminal_ && (no_color == nullptr || *no_color == '\0');
}

std::size_t Console::width() const {
  winsize size{};
  if (ioctl(fileno(stream_), TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 80;
  return size.ws_col;
}

std::size_t Console::height() const {
  winsize size{};
  if (ioctl(fileno(stream_), TIOCGWINSZ, &size) != 0 || size.ws_row == 0) return 24;
  return size.ws_row;
}

void Console::line(const std::string& text) const { raw(text + "\n"); }

void Console::raw(const std::string& text) const {
  std::fwrite(text.data(), 1, text.size(), stream_);
  std::fflush(stream_);
}

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

// The innermost command on the command line, or the program.
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
  fmt::print(stderr, "{0}{1}: {2}\nTry: {0}{1} --help\n", program.get_name(), path, message);
  return kUsage;
}

// The program with this name, such as "multipanda lab", and these commands.
int run(int argc, char** argv, const ProgramWords& words, std::initializer_list<AddCommand> commands) {
  Program program;
  program.app.name(words.name);
  program.app.description(words.description);
  program.app.set_version_flag("--version", MULTIPANDA_VERSION);
  program.app.require_subcommand(1);
  program.app.footer(words.footer);
  for (const AddCommand add : commands) add(program);
  try {
    program.app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return program.app.exit(error);  // --help, --version
    return wrong_use(program.app, error);
  }
  return program.exit_code;
}

}  // namespace

int run_program(int argc, char** argv, const ProgramWords& words,
                std::initializer_list<AddCommand> commands) {
  std::signal(SIGPIPE, SIG_IGN);  // a closed output pipe must not end the control loop
  try {
    return run(argc, argv, words, commands);
  } catch (const std::invalid_argument& error) {
    fmt::print(stderr, "multipanda: {}\n", error.what());
    return kUsage;
  } catch (const std::exception& error) {
    fmt::print(stderr, "multipanda: {}\n", error.what());
    return kFailed;
  }
}

CLI::Option* scene_option(CLI::App* command, std::string& scene) {
  return option(command, "scene", scene, "Name (see multipanda list scenes) or path of a scene file",
                required);
}

void json_flag(CLI::App* command, bool& json) {
  command->add_flag("--json", json,
                    "Print one JSON object to standard output at the end, messages to standard error");
}

std::optional<std::pair<std::string, std::string>> key_and_value(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size()) return {};
  return std::pair(text.substr(0, equals), text.substr(equals + 1));
}

int become(const char* program, char** argv) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string path = (self.parent_path() / program).string();
  argv[0] = const_cast<char*>(path.c_str());
  execv(path.c_str(), argv);
  fmt::print(stderr, "multipanda: cannot start {} ({}); in the source tree, build it with ./multipanda {}\n",
             path, std::strerror(errno), argv[1] == nullptr ? "lab" : fmt::format("lab {} --help", argv[1]));
  return kFailed;
}

CLI::App* Program::add(const std::string& argument, const std::string& what, const std::string& examples) {
  CLI::App* command = app.add_subcommand(argument, what);
  command->footer("Examples:\n" + examples);
  return command;
}

}  // namespace multipanda::cli
