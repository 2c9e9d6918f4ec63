#include "commission/findings.hpp"

#include <cmath>
#include <utility>

#include <fmt/format.h>

namespace multipanda::commission {

bool Reading::good() const {
  if (std::isnan(value)) return false;
  return at_least ? value >= limit : value <= limit;
}

std::string reading_text(const Json& json) {
  const auto arm = json["arm"].get<std::string>(), unit = json["unit"].get<std::string>();
  const std::string with_unit = unit.empty() ? "" : " " + unit;
  std::string line = fmt::format(
      "{}{}: {}{}", arm.empty() ? "" : arm + ": ", json["quantity"].get<std::string>(),
      json["value"].is_null() ? "not a number" : fmt::format("{:.3g}", json["value"].get<double>()),
      with_unit);
  if (!json["limit"].is_null())
    line += fmt::format(" ({} {:g}{})", json["at_least"].get<bool>() ? "at least" : "at most",
                        json["limit"].get<double>(), with_unit);
  return line + (json["good"].get<bool>() ? "" : "  NO-GO");
}

std::string to_string(Verdict verdict) {
  return verdict == Verdict::go ? "go" : verdict == Verdict::no_go ? "no-go" : "skipped";
}

void StepResult::fail(std::string what_found, std::string what_expected, std::string what_to_do) {
  if (verdict == Verdict::no_go) return;  // the first one counts
  verdict = Verdict::no_go;
  found = std::move(what_found);
  expected = std::move(what_expected);
  remedy = std::move(what_to_do);
}

void StepResult::add(Reading reading, const std::string& remedy_, const std::string& found_) {
  const std::string unit = reading.unit.empty() ? "" : " " + reading.unit;
  if (!reading.good()) {
    fail(fmt::format("{}{} is {:.3g}{}{}", reading.arm.empty() ? "" : "arm '" + reading.arm + "': ",
                     reading.quantity, reading.value, unit, found_.empty() ? "" : ", " + found_),
         fmt::format("{} {:g}{}", reading.at_least ? "at least" : "at most", reading.limit, unit), remedy_);
  }
  readings.push_back(std::move(reading));
}

void StepResult::at_most(const std::string& arm, const std::string& quantity, double value,
                         const std::string& unit, double limit, const std::string& what_to_do,
                         const std::string& what_found) {
  add({arm, quantity, value, unit, limit}, what_to_do, what_found);
}

void StepResult::at_least(const std::string& arm, const std::string& quantity, double value,
                          const std::string& unit, double limit, const std::string& what_to_do,
                          const std::string& what_found) {
  add({arm, quantity, value, unit, limit, true}, what_to_do, what_found);
}

void StepResult::show(const std::string& arm, const std::string& quantity, double value,
                      const std::string& unit) {
  readings.push_back({arm, quantity, value, unit, kShown});
}

Json to_json(const StepResult& result) {
  Json json{{"verdict", to_string(result.verdict)}, {"readings", Json::array()}, {"notes", result.notes}};
  for (const auto& reading : result.readings) {
    json["readings"].push_back({{"arm", reading.arm},
                                {"quantity", reading.quantity},
                                {"value", std::isfinite(reading.value) ? Json(reading.value) : Json()},
                                {"unit", reading.unit},
                                {"limit", std::isfinite(reading.limit) ? Json(reading.limit) : Json()},
                                {"at_least", reading.at_least},
                                {"good", reading.good()}});
  }
  if (result.verdict == Verdict::no_go) {
    json["found"] = result.found;
    json["expected"] = result.expected;
    json["remedy"] = result.remedy;
  }
  if (!result.measured.empty()) json["measured"] = result.measured;
  return json;
}

}  // namespace multipanda::commission
