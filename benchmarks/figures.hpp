#pragma once

#include <functional>
#include <regex>
#include <string>
#include <vector>

namespace multipanda::bench {

// Statistics of a series of measurements.
struct Figures {
  double median = 0, p999 = 0, worst = 0;  // p999: 99.9 % quantile (nearest rank)
};
Figures figures_of(std::vector<double> values);  // not empty

// A repeatedly timed operation.
struct Case {
  std::string name;  // "cycle_us/hold/1"
  std::function<void()> once;
  std::function<void()> verify;     // called afterwards: throws if the case did not run as intended; may be
                                    // empty
  std::vector<double> durations{};  // [us]
};

// Selects the cases whose name contains a match. Throws std::regex_error.
class Filter {
 public:
  explicit Filter(const std::string& expression) : expression_(expression) {}
  bool operator()(const std::string& name) const { return std::regex_search(name, expression_); }

 private:
  std::regex expression_;
};

// Times every case `samples` times, in alternation: a block of each, then the next block of each, so that
// other load affects all of them equally. Within a block caches are warm except for its first calls, which
// count. Ends after a complete round when `budget_s` is over.
void measure_in_turns(std::vector<Case>& cases, std::size_t samples, double budget_s);

}  // namespace multipanda::bench
