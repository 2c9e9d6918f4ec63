#include <fmt/format.h>

#include "cli/program.hpp"
#include "scene/build.hpp"
#include "scene/scene_reference.hpp"

namespace multipanda::cli {

void add_docs(Program& program) {
  CLI::App* command = program.add("docs", "Prints documentation that is generated from the program itself",
                                  "  multipanda docs scene > docs/scene_reference.md");
  command->require_subcommand(1);
  program.on(command->add_subcommand("scene", "Reference of the scene file (Markdown)"), [] {
    fmt::print("{}", scene_reference_markdown(build_registry({})));
    return kSuccess;
  });
}

}  // namespace multipanda::cli
