#pragma once

#include <limits>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace multipanda::commission {

using Json = nlohmann::ordered_json;

// The limit of a figure that is only shown.
inline constexpr double kShown = std::numeric_limits<double>::infinity();

// One judged figure of a step.
struct Reading {
  std::string arm;       // empty: of the computer, or of all arms
  std::string quantity;  // "largest torque at rest"
  double value = 0;
  std::string unit;       // "N m"
  double limit = 0;       // infinite: shown only
  bool at_least = false;  // the value must reach the limit; otherwise it may not exceed it
  // What was found, in words, and what to do; both used if the figure is beyond its limit.
  std::string found, remedy;

  bool good() const;  // false for a value that is not a number
};

enum class Verdict { go, no_go, skipped };
std::string to_string(Verdict verdict);

// The result of a step. The first figure that is not good makes it a no-go.
struct StepResult {
  Verdict verdict = Verdict::go;
  std::vector<Reading> readings;
  std::vector<std::string> notes;       // what a person should know; no judgment
  std::string found, expected, remedy;  // of a no-go
  Json measured = Json::object();       // curves for the page, by arm

  void add(Reading reading);
  void fail(std::string what_found, std::string what_expected, std::string what_to_do);
};

Json to_json(const StepResult& result);
std::string reading_text(const Json& reading);  // of an element of "readings"

}  // namespace multipanda::commission
