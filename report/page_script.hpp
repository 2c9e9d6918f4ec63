#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

// Why no page can be drawn: missing interpreter or Python packages, and how to get them. Empty: nothing is
// missing. Any thread, off the loop only.
std::string missing_page_packages();

// A Python script of multipanda that draws a page from data files (common/own_files.hpp finds it and the
// interpreter). Any thread, off the loop only.
class PageScript {
 public:
  // `script`: "report/report.py"; `page`: its result, for messages: "the report". Throws std::runtime_error
  // if the script does not exist or Python packages are missing.
  PageScript(const std::filesystem::path& script, std::string page);

  // Takes seconds. Throws std::runtime_error with the script's output if it fails.
  void run(const std::vector<std::string>& arguments) const;

 private:
  std::filesystem::path python_, script_;
  std::string page_;
};

}  // namespace multipanda
