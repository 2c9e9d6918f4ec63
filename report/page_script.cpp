#include "report/page_script.hpp"

#include <initializer_list>
#include <stdexcept>
#include <utility>

#include "common/own_files.hpp"
#include "common/process.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

// -E: keeps PYTHONPATH of a sourced ROS 2 from hiding the interpreter's packages.
std::vector<std::string> interpreter_arguments(std::initializer_list<std::string> more) {
  std::vector<std::string> all{"-E", "-B"};
  all.insert(all.end(), more);
  return all;
}

// Checks without importing, which would take a second. The first entry of sys.path is the current folder.
constexpr const char* kPrintMissing =
    "import importlib.util as u, sys; sys.path.pop(0); "
    "print(*(name for name in ('matplotlib', 'numpy') if u.find_spec(name) is None))";

}  // namespace

std::string missing_page_packages() {
  const fs::path python = page_python();
  if (!fs::exists(python)) return "there is no " + python.string() + "; " + page_packages_cure();
  const ProgramResult looked = run_program(python, interpreter_arguments({"-c", kPrintMissing}));
  if (!looked.good()) return python.string() + " does not run: " + looked.output + looked.reason;
  std::string names = looked.output;
  while (!names.empty() && (names.back() == '\n' || names.back() == ' ')) names.pop_back();
  if (names.empty()) return {};
  return python.string() + " has no " + names + "; " + page_packages_cure();
}

PageScript::PageScript(const fs::path& script, std::string page)
    : python_(page_python()), script_(share_folder() / script), page_(std::move(page)) {
  if (!fs::exists(script_))
    throw std::runtime_error(page_ + " needs " + script_.string() +
                             ", which does not exist; install multipanda again");
  if (const std::string missing = missing_page_packages(); !missing.empty())
    throw std::runtime_error(page_ + " needs Python packages: " + missing);
}

void PageScript::run(const std::vector<std::string>& arguments) const {
  std::vector<std::string> all = interpreter_arguments({script_.string()});
  all.insert(all.end(), arguments.begin(), arguments.end());
  const ProgramResult made = run_program(python_, all);
  if (!made.good()) {
    throw std::runtime_error(page_ + " was not made; " + script_.string() + " reported:\n" + made.output +
                             made.reason);
  }
}

}  // namespace multipanda
