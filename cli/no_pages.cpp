#include <stdexcept>

#include "report/page_script.hpp"
#include "report/report.hpp"

// What a program for arms alone has in place of report/.
namespace multipanda {

std::string missing_page_packages() {
  return "a program for arms alone draws no pages and makes no data sets; the package multipanda does, from "
         "the same logs";
}

ReportResult make_report(const std::filesystem::path&, const ReportOptions&) {
  throw std::runtime_error(missing_page_packages());
}

LerobotResult export_lerobot(const std::vector<std::filesystem::path>&, const std::filesystem::path&,
                             const LerobotOptions&) {
  throw std::runtime_error(missing_page_packages());
}

}  // namespace multipanda
