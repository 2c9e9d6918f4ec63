#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace multipanda::doctor {

// How good something is. Sorted by weight: what is unknown weighs more than what is fine, less than a doubt.
enum class Judgement { ok, unknown, warning, bad };
std::string_view to_string(Judgement judgement);

// What the computer is to do. The same reading can be fine for simulated arms and bad for real ones, which
// stop when torques come late.
enum class Purpose { simulated_arms, real_arms };

struct Figure {
  std::string name;  // "p99"
  double value = 0;
  std::string unit;  // "us"; empty: a plain number
};

struct Bar {
  double from = 0, to = 0;  // [us]; to: infinite in the last one
  std::size_t count = 0;
};

// One line of the examination.
struct Finding {
  std::string id;        // for programs: "timer_wake_up"
  std::string subject;   // for people: "timer wake-up at 1 kHz"
  std::string measured;  // with unit
  Judgement judged = Judgement::unknown;
  std::string cause, cure;  // empty when all is well; when unknown: why it is, and how it could be known
  std::vector<Figure> figures;
  std::vector<Bar> histogram;
};

// The weight of a defect: what is bad for real arms is worth a warning where arms are simulated.
inline Judgement defect(Purpose purpose) {
  return purpose == Purpose::real_arms ? Judgement::bad : Judgement::warning;
}

// The worst of all.
Judgement verdict(const std::vector<Finding>& findings);

// What of all that was found explains late torques best, strongest first, one sentence each; empty: nothing
// does.
std::vector<std::string> blame(const std::vector<Finding>& findings);

// One object on one line: docs/doctor.md.
std::string to_json(const std::vector<Finding>& findings, Purpose purpose, double seconds);

// The finding as lines for people, aligned; colours where the console has them.
std::vector<std::string> to_text(const Finding& finding, bool colour);

}  // namespace multipanda::doctor
