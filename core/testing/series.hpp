#pragma once

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "core/testing/full_series.hpp"

namespace multipanda::test {

// The cases of a long series: the loops of a test ask takes() before each, which numbers them from 0. What
// all cases say together is checked after the loops, from what they have recorded.
//
//     test::Series series;
//     for (...) {
//       if (!series.takes(seed < 20)) continue;  // in the tenth that runs by default
//       series.record("swing_m", outcome.swing);
//       EXPECT_LT(outcome.swing, 1e-3);
//     }
//     if (series.whole()) EXPECT_GT(series.sum("pushed"), series.size() / 2.0);
//
// `./multipanda test --long` makes a study of every case (docs/studies.md). It sets MULTIPANDA_SERIES:
//     count         no case runs; their number is recorded as `cases`
//     case:17       this case runs
//     figures:FILE  no case runs; the file has what all of them have recorded,
//                   a line per figure: `FIGURE value value ...`
//     tenth         the tenth runs, whatever MULTIPANDA_FULL says
// Without it the tenth runs, and with MULTIPANDA_FULL=1 every case.
class Series {
 public:
  Series() {
    const char* given = std::getenv("MULTIPANDA_SERIES");
    const std::string text = given == nullptr ? "" : given;
    if (text.empty()) {
      mode_ = full_series() ? Mode::all : Mode::tenth;
    } else if (text == "tenth") {
      mode_ = Mode::tenth;
    } else if (text == "count") {
      mode_ = Mode::count;
    } else if (text.starts_with("case:")) {
      mode_ = Mode::one;
      selected_ = std::stoul(text.substr(5));
    } else if (text.starts_with("figures:")) {
      mode_ = Mode::figures;
      read(text.substr(8));
    } else {
      ADD_FAILURE() << "MULTIPANDA_SERIES is '" << text << "'; expected count, case:N, figures:FILE or tenth";
    }
  }
  ~Series() {
    if (mode_ == Mode::count) testing::Test::RecordProperty("cases", std::to_string(cases_));
    if (mode_ == Mode::one && taken_ == 0)
      ADD_FAILURE() << "there is no case " << selected_ << "; the series has " << cases_;
  }
  Series(const Series&) = delete;
  Series& operator=(const Series&) = delete;

  // Whether the next case runs here. `in_tenth`: whether it does by default.
  bool takes(bool in_tenth) {
    const std::size_t number = cases_++;
    const bool taken = mode_ == Mode::all || (mode_ == Mode::tenth && in_tenth) ||
                       (mode_ == Mode::one && number == selected_);
    taken_ += taken;
    return taken;
  }
  // A figure of the case that was taken last.
  void record(const std::string& figure, double value) {
    recorded_[figure].push_back(value);
    if (mode_ != Mode::one) return;
    std::ostringstream text;
    text.precision(17);  // exact
    text << value;
    testing::Test::RecordProperty(figure, text.str());
  }

  // Whether all cases that are meant to run are known here: not in a process that runs or counts one of many.
  bool whole() const { return mode_ != Mode::one && mode_ != Mode::count; }
  // Whether those are all cases, not a tenth.
  bool full() const { return mode_ != Mode::tenth; }
  // How many there are.
  std::size_t size() const { return mode_ == Mode::figures ? of("cases").size() : taken_; }
  // What all of them have recorded, in order; empty if none has.
  const std::vector<double>& of(const std::string& figure) const {
    static const std::vector<double> kNone;
    const auto found = recorded_.find(figure);
    return found == recorded_.end() ? kNone : found->second;
  }
  double sum(const std::string& figure) const {
    double sum = 0;
    for (const double value : of(figure)) sum += value;
    return sum;
  }
  double largest(const std::string& figure) const {  // of those that are not negative
    double largest = 0;
    for (const double value : of(figure)) largest = std::max(largest, value);
    return largest;
  }

 private:
  enum class Mode { tenth, all, one, count, figures };

  void read(const std::string& path) {
    std::FILE* file = std::fopen(path.c_str(), "r");
    if (file == nullptr) {
      ADD_FAILURE() << "cannot read " << path;
      return;
    }
    std::string text;
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) text += static_cast<char>(c);
    std::fclose(file);
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::string figure, value;
      words >> figure;
      auto& values = recorded_[figure];
      while (words >> value) values.push_back(std::stod(value));
    }
  }

  Mode mode_ = Mode::tenth;
  std::size_t selected_ = 0, cases_ = 0, taken_ = 0;
  std::map<std::string, std::vector<double>> recorded_;
};

}  // namespace multipanda::test
