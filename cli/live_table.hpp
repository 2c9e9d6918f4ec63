#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "cli/program.hpp"
#include "runtime/run_monitor.hpp"

namespace multipanda::cli {

struct TableStyle {
  std::size_t width = 100, height = 24;  // largest number of columns and lines (color codes not counted)
  bool color = false;
};
// The live table as lines. Its height depends on the number of arms and the style only. Columns: torque as a
// fraction of its limit, cycles in which the safety stage limited or replaced it.
std::vector<std::string> table_lines(const RunStatus& status, const std::string& scene, double duration_s,
                                     const TableStyle& style);
// The same in one line without colors, for outputs that are not a terminal.
std::string plain_line(const RunStatus& status, double duration_s);

// Shows a running session: on a terminal a table that is redrawn in place, elsewhere a line per second and a
// line per event.
class LiveDisplay {
 public:
  LiveDisplay(const Console& console, std::string scene, double duration_s);
  void show(const RunStatus& status);    // call every kPeriod_s
  void finish(const RunStatus& status);  // leaves the last state on the screen

  static constexpr double kPeriod_s = 0.2;

 private:
  void draw(const RunStatus& status);
  void print_news(const RunStatus& status);

  const Console& console_;
  std::string scene_;
  double duration_s_;
  std::size_t drawn_ = 0;      // lines on the screen
  std::uint64_t printed_ = 0;  // events
  double next_line_s_ = 1;     // elapsed time of the next plain line
};

}  // namespace multipanda::cli
