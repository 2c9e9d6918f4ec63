#include <array>
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "fci/server/virtual_arms.hpp"

namespace multipanda::fci {
namespace {

using Words = std::vector<std::string>;

struct Expected : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

double number(const std::string& word, const std::string& what) {
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (end == word.c_str() || *end != '\0' || !std::isfinite(value)) {
    throw Expected("expected " + what + ", found '" + word + "'");
  }
  return value;
}

bool on_or_off(const std::string& word) {
  if (word != "on" && word != "off") throw Expected("expected on or off, found '" + word + "'");
  return word == "on";
}

std::string done(bool taken) { return taken ? "ok" : "too many commands at once: try again"; }

std::string answer(std::future<RequestAnswer> future) {
  const RequestAnswer said = future.get();
  return said.success ? "ok" : said.reason;
}

// Commands that change one field of the faults each, in units of `unit`.
template <double DatagramFaults::*kField>
std::string set_fault(VirtualArms& arms, ArmIndex arm, const std::string& word, const char* what,
                      double unit = 1) {
  DatagramFaults faults = arms.faults(arm);
  faults.*kField = unit * number(word, what);
  return done(arms.set_faults(arm, faults));
}

Vector3 vector(const Words& words, const char* what) {
  return {number(words[0], what), number(words[1], what), number(words[2], what)};
}

struct Word {
  std::string_view name, arguments, meaning;
  std::size_t count;  // of the arguments behind the arm's name
  std::string (*run)(VirtualArms&, ArmIndex, const Words&);
};

constexpr double kMicro = 1e-6;

const std::array kWords{
    Word{"user-stop", "ARM on|off", "press or release the stop button", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return answer(arms.request(arm, SetUserStop{on_or_off(w[0])}));
         }},
    Word{"guide", "ARM on|off", "press or release the guiding buttons", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return done(arms.press_guiding(arm, on_or_off(w[0])));
         }},
    Word{"reflex", "ARM ERROR", "stop the arm as if it had detected this error: joint_reflex, ...", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           const auto error = arm_error_from(w[0]);
           if (!error) throw Expected("there is no error '" + w[0] + "'; one is joint_reflex");
           return done(arms.raise(arm, *error));
         }},
    Word{"recover", "ARM", "recover from an error, as a program does", 0,
         [](VirtualArms& arms, ArmIndex arm, const Words&) {
           return answer(arms.request(arm, RecoverFromError{}));
         }},
    Word{"latency", "ARM MICROSECONDS", "delay datagrams in both directions", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return set_fault<&DatagramFaults::latency_s>(arms, arm, w[0], "microseconds", kMicro);
         }},
    Word{"jitter", "ARM MICROSECONDS", "delay datagrams by a random time up to this", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return set_fault<&DatagramFaults::jitter_s>(arms, arm, w[0], "microseconds", kMicro);
         }},
    Word{"loss", "ARM SHARE", "lose this fraction of the datagrams in both directions", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return set_fault<&DatagramFaults::loss>(arms, arm, w[0], "a share");
         }},
    Word{"duplicate", "ARM SHARE", "deliver this fraction of the datagrams twice", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return set_fault<&DatagramFaults::duplicate>(arms, arm, w[0], "a share");
         }},
    Word{"reorder", "ARM SHARE", "let the next datagram overtake this fraction of the datagrams", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return set_fault<&DatagramFaults::reorder>(arms, arm, w[0], "a share");
         }},
    Word{"freeze", "ARM SECONDS", "stop sending and receiving at the port for this time", 1,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return done(arms.freeze(arm, number(w[0], "seconds")));
         }},
    Word{"close", "ARM", "close the connection to the program", 0,
         [](VirtualArms& arms, ArmIndex arm, const Words&) { return done(arms.close_connection(arm)); }},
    Word{"push", "ARM FX FY FZ [SECONDS]", "apply a force to the flange (N, world axes; default 0.5 s)", 3,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return done(arms.push(arm, vector(w, "a force"), w.size() > 3 ? number(w[3], "seconds") : 0.5));
         }},
    Word{"lead", "ARM X Y Z [SECONDS]",
         "guide the end effector to a position in the world by hand (m, at most 10 N; default 5 s)", 3,
         [](VirtualArms& arms, ArmIndex arm, const Words& w) {
           return done(arms.lead(arm, vector(w, "a place"), w.size() > 3 ? number(w[3], "seconds") : 5));
         }},
};

std::string list_of(const std::vector<std::string>& names) {
  std::string result;
  for (const auto& name : names) result += (result.empty() ? "" : ", ") + name;
  return result;
}

std::string carry_out(VirtualArms& arms, Words words) {
  const std::string name = words[0];
  if (name == "help") return control_help();
  for (const Word& word : kWords) {
    if (word.name != name) continue;
    const std::string usage = "expected " + std::string(word.name) + " " + std::string(word.arguments);
    if (words.size() < 2) throw Expected(usage);
    const auto arm = arms.find(words[1]);
    if (!arm) throw Expected("there is no arm '" + words[1] + "'; there are " + list_of(arms.names()));
    words.erase(words.begin(), words.begin() + 2);
    const std::size_t most = word.count + (word.name == "push" || word.name == "lead" ? 1 : 0);
    if (words.size() < word.count || words.size() > most) throw Expected(usage);
    return word.run(arms, *arm, words);
  }
  throw Expected("unknown command '" + name + "'; 'help' lists them");
}

}  // namespace

std::string control(VirtualArms& arms, const std::string& line) {
  std::istringstream stream(line);
  Words words;
  for (std::string word; stream >> word;) words.push_back(word);
  if (words.empty()) return {};
  try {
    return carry_out(arms, std::move(words));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

std::string control_help() {
  std::string text = "words:";
  for (const Word& word : kWords) {
    text += (&word == kWords.data() ? " " : "; ") + std::string(word.name) + " " +
            std::string(word.arguments) + " (" + std::string(word.meaning) + ")";
  }
  return text;
}

}  // namespace multipanda::fci
