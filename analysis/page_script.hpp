#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

// A Python script of analysis/ that draws a page from data written before. It stands in the folder of the
// environment variable MULTIPANDA_SHARE, else of the project, and is run by the interpreter in
// MULTIPANDA_PYTHON, else that of the project's Python environment. Any thread, off the loop only.
class PageScript {
 public:
  // `below_analysis`: "report.py"; `page`: what it makes, for messages: "the report". Throws
  // std::runtime_error if script or interpreter are not there.
  PageScript(const std::filesystem::path& below_analysis, std::string page);

  // Takes seconds. Throws std::runtime_error with what the script said when it ended badly.
  void run(const std::vector<std::string>& arguments) const;

 private:
  std::filesystem::path python_, script_;
  std::string page_;
};

}  // namespace multipanda
