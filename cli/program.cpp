#include "cli/program.hpp"

namespace multipanda::cli {

CLI::App* Program::add(const std::string& argument, const std::string& what, const std::string& examples) {
  CLI::App* command = app.add_subcommand(argument, what);
  command->footer("Examples:\n" + examples);
  return command;
}

}  // namespace multipanda::cli
