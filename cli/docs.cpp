#include <fmt/format.h>

#include "cli/program.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {

void add_docs(Program& program) {
  CLI::App* command = program.add("docs", "Print documentation generated from the program",
                                  "  multipanda docs scene > docs/scene_reference.md");
  command->require_subcommand(1);
  program.on(command->add_subcommand("scene", "Print the reference of scene files (Markdown)"), [] {
    fmt::print("{}", scene_reference_markdown(build_registry({})));
    return kSuccess;
  });
}

}  // namespace multipanda::cli
