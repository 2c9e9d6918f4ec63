#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace multipanda::doctor {

// Judgment of a finding, in ascending order of severity.
enum class Judgment { ok, unknown, warning, bad };
std::string_view to_string(Judgment judgment);

// Purpose of the computer. The same reading can be good for simulated arms and bad for real ones, which stop
// if torques are late.
enum class Purpose { simulated_arms, real_arms };

struct Figure {
  Figure(std::string name_, auto value_, std::string unit_)
      : name(std::move(name_)), value(static_cast<double>(value_)), unit(std::move(unit_)) {}
  std::string name;  // "p99"
  double value;
  std::string unit;  // "us"; empty: a plain number
};

struct Bar {
  double from = 0, to = 0;  // [us]; to: infinite in the last one
  std::size_t count = 0;
};

struct Distribution;

// One line of the examination.
struct Finding {
  std::string id;        // identifier: "timer_wake_up"
  std::string subject;   // human-readable: "timer wake-up at 1 kHz"
  std::string measured;  // with unit
  Judgment judged = Judgment::unknown;
  std::string cause, cure;  // empty if ok; if unknown: the reason, and how to find out
  std::vector<Figure> figures;
  std::vector<Bar> histogram;

  // Both return the finding, for the end of a judgment.
  Finding& as(Judgment judgment, std::string why = {}, std::string do_this = {});
  Finding& because(std::string why, std::string do_this = {}) {
    return as(judged, std::move(why), std::move(do_this));
  }
  void show(const Distribution& distribution);  // its figures and its histogram
};

// Judgment of a defect: bad for real arms, a warning for simulated ones.
inline Judgment defect(Purpose purpose) {
  return purpose == Purpose::real_arms ? Judgment::bad : Judgment::warning;
}

// The worst judgment of all findings.
Judgment verdict(const std::vector<Finding>& findings);

// The findings that explain late torques, strongest first, one sentence each; empty if none does.
std::vector<std::string> blame(const std::vector<Finding>& findings);

// One JSON object on one line (docs/commission.md).
std::string to_json(const std::vector<Finding>& findings, Purpose purpose, double seconds);

// The finding as aligned human-readable lines, with colors on request.
std::vector<std::string> to_text(const Finding& finding, bool color);

// Distribution of single durations [us].
struct Distribution {
  std::size_t count = 0;
  double p50 = 0, p99 = 0, p999 = 0, worst = 0;
  std::vector<Bar> bars;  // steps of 1, 2, 5 from 1 us; from the first to the last nonempty one

  std::vector<Figure> figures() const;
  std::string text() const;  // "p50 4.1, p99 9.8, p99.9 31, worst 120 us"
};

// Nearest-rank percentile: the smallest value that a given fraction of all values does not exceed.
Distribution distribution_of(std::vector<double> us);
// Fraction of the values above `limit`, 0 to 1.
double share_above(const std::vector<double>& us, double limit);

// The kernel's files in /proc and /sys. Files that are missing or not readable give no value. Tests use
// another root.
class SystemFiles {
 public:
  explicit SystemFiles(std::filesystem::path root = "/") : root_(std::move(root)) {}

  std::filesystem::path path(const std::string& file) const { return root_ / file; }
  bool exists(const std::string& file) const;
  // Whole content; `file` without a leading slash: "proc/stat".
  std::optional<std::string> text(const std::string& file) const;
  // First line, without surrounding spaces.
  std::optional<std::string> line(const std::string& file) const;
  std::optional<double> number(const std::string& file) const;  // of the first line
  std::vector<std::string> lines(const std::string& file) const;
  std::vector<std::string> names(const std::string& folder) const;  // of its entries, sorted

 private:
  std::filesystem::path root_;
};

// "0-2,5" -> {0, 1, 2, 5}. Stops at the first invalid character.
std::vector<int> parse_core_list(const std::string& text);

}  // namespace multipanda::doctor
