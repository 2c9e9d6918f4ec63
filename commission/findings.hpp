#pragma once

#include <limits>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace multipanda::commission {

using Json = nlohmann::ordered_json;

// A figure without limit is only shown.
inline constexpr double kShown = std::numeric_limits<double>::infinity();

// One figure of a step.
struct Reading {
  std::string arm;       // empty: of the computer, or of all arms
  std::string quantity;  // "largest torque at rest"
  double value = 0;
  std::string unit;       // "N m"
  double limit = 0;       // infinite: shown only
  bool at_least = false;  // the value must reach the limit; otherwise it may not exceed it

  bool good() const;  // false for a value that is not a number
};

enum class Verdict { go, no_go, skipped };
std::string to_string(Verdict verdict);

// The result of a step. The first figure that is not good makes it a no-go.
struct StepResult {
  Verdict verdict = Verdict::go;
  std::vector<Reading> readings;
  std::vector<std::string> notes;       // information for the person, not judged
  std::string found, expected, remedy;  // of a no-go
  Json measured = Json::object();       // curves for the page, by arm

  // Figures with unit and limit; `remedy` and `found` (in words) are used if the value is beyond the limit or
  // not a number.
  void at_most(const std::string& arm, const std::string& quantity, double value, const std::string& unit,
               double limit, const std::string& remedy, const std::string& found = {});
  void at_least(const std::string& arm, const std::string& quantity, double value, const std::string& unit,
                double limit, const std::string& remedy, const std::string& found = {});
  // A figure that is not judged.
  void show(const std::string& arm, const std::string& quantity, double value, const std::string& unit);
  void fail(std::string what_found, std::string what_expected, std::string what_to_do);

 private:
  void add(Reading reading, const std::string& remedy, const std::string& found);
};

Json to_json(const StepResult& result);
std::string reading_text(const Json& reading);  // text of an element of "readings"

}  // namespace multipanda::commission
