#pragma once

#include <functional>
#include <regex>
#include <string>
#include <vector>

namespace multipanda::bench {

// What is said of a series of measurements.
struct Figures {
  double median = 0, p999 = 0, worst = 0;  // p999: what 99.9 % of all do not exceed (nearest rank)
};
Figures figures_of(std::vector<double> values);  // not empty

// Something that is timed again and again.
struct Case {
  std::string name;  // "cycle_us/hold/1"
  std::function<void()> once;
  std::function<void()> verify;     // afterwards: throws if it did not do what its name says; may be empty
  std::vector<double> durations{};  // [us]
};

// Which cases are wanted: those whose name contains a match. Throws std::regex_error.
class Filter {
 public:
  explicit Filter(const std::string& expression) : expression_(expression) {}
  bool operator()(const std::string& name) const { return std::regex_search(name, expression_); }

 private:
  std::regex expression_;
};

// Times every case `samples` times, in turns: a block of each, then the next block of each, so that whatever
// else the machine does hits all alike. Within a block caches are warm but for its first calls, which count.
// Ends after a whole turn when `budget_s` is over; every case has been timed once per call of the turn then.
void measure_in_turns(std::vector<Case>& cases, std::size_t samples, double budget_s);

}  // namespace multipanda::bench
