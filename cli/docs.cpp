#include <algorithm>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "common/own_files.hpp"
#include "common/text.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda::cli {
namespace {

// "docs/errors.md#reflexes", "errors.md", "errors"
std::string page_named(std::string name) {
  if (name.starts_with("docs/")) name.erase(0, 5);
  name = name.substr(0, name.find('#'));
  if (name.ends_with(".md")) name.resize(name.size() - 3);
  return name;
}

int print_page(const std::string& name) {
  namespace fs = std::filesystem;
  if (name == "scene") {
    fmt::print("{}", scene_reference_markdown(build_registry({})));
    return kSuccess;
  }
  const fs::path folder = share_folder() / "docs";
  std::vector<std::string> pages;
  std::error_code missing;
  for (const auto& entry : fs::recursive_directory_iterator(folder, missing)) {
    if (entry.path().extension() == ".md")
      pages.push_back(entry.path().lexically_relative(folder).replace_extension().string());
  }
  std::ranges::sort(pages);
  const std::string page = page_named(name);
  if (page.empty()) {
    fmt::print("{}\n", fmt::join(pages, "\n"));
  } else if (std::ranges::find(pages, page) == pages.end()) {
    throw ConfigError({name, 0}, "there is no such page" + name_hint(page, pages, "there are none"));
  } else {
    fmt::print("{}", read_text((folder / (page + ".md")).string()));
  }
  return kSuccess;
}

}  // namespace

void add_docs(Program& program) {
  auto page = std::make_shared<std::string>();
  CLI::App* command = program.add("docs", "Print a page of the documentation, or list the pages",
                                  "  multipanda docs errors\n"
                                  "  multipanda docs scene > docs/scene_reference.md");
  command->add_option("page", *page,
                      "Page, as in messages (docs/errors.md) or short (errors); scene: the reference of "
                      "scene files");
  program.on(command, [page] { return print_page(*page); });
}

}  // namespace multipanda::cli
