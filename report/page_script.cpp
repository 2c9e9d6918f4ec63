#include "report/page_script.hpp"

#include <cstdlib>
#include <stdexcept>
#include <utility>

#include "support/child_process.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

fs::path from_environment(const char* name, const fs::path& otherwise) {
  const char* value = std::getenv(name);
  return value != nullptr && *value != '\0' ? fs::path(value) : otherwise;
}

}  // namespace

PageScript::PageScript(const fs::path& script, std::string page)
    : python_(from_environment("MULTIPANDA_PYTHON", MULTIPANDA_DEFAULT_PYTHON)),
      script_(from_environment("MULTIPANDA_SHARE", MULTIPANDA_DEFAULT_SHARE) / script),
      page_(std::move(page)) {
  for (const fs::path& needed : {python_, script_}) {
    if (!fs::exists(needed)) {
      throw std::runtime_error(page_ + " needs " + needed.string() +
                               ", which does not exist; run ./multipanda setup");
    }
  }
}

void PageScript::run(const std::vector<std::string>& arguments) const {
  std::vector<std::string> all{"-I", "-B", script_.string()};
  all.insert(all.end(), arguments.begin(), arguments.end());
  const ProgramResult made = run_program(python_, all);
  if (!made.good()) {
    throw std::runtime_error(page_ + " was not made; " + script_.string() + " says:\n" + made.output +
                             made.reason);
  }
}

}  // namespace multipanda
