#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

// A Python script of the project that draws a page from data files. It is in the folder given by the
// environment variable MULTIPANDA_SHARE (default: the project's), and runs with the interpreter in
// MULTIPANDA_PYTHON (default: the project's Python environment). Any thread, off the loop only.
class PageScript {
 public:
  // `script`: "report/report.py"; `page`: its result, for messages: "the report". Throws std::runtime_error
  // if script or interpreter do not exist.
  PageScript(const std::filesystem::path& script, std::string page);

  // Takes seconds. Throws std::runtime_error with the script's output if it fails.
  void run(const std::vector<std::string>& arguments) const;

 private:
  std::filesystem::path python_, script_;
  std::string page_;
};

}  // namespace multipanda
