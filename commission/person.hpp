#pragma once

#include <functional>
#include <optional>
#include <stdexcept>
#include <string>

namespace multipanda::commission {

// The person ended the tour, or nobody can answer any more.
struct Ended : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The person beside the arms: who is asked before anything moves. Nothing is ever assumed: without an answer
// the tour ends, with its arms in hold.
//
// Answers come as lines from a file descriptor: a terminal (an empty line is "go"), or with `named` a file or
// pipe whose lines are "ID: answer", in the order of the questions; an answer to another question is refused.
class Person {
 public:
  struct Options {
    int file = 0;        // descriptor to read from
    bool named = false;  // lines name their question
    // With `named`: an answer may be there before its question. For virtual arms only; for others it is
    // refused, because whoever wrote it has not seen the arm.
    bool early = false;
    std::string source;  // for messages: "the answers of answers.txt"
    std::function<void(const std::string& id, const std::string& text)> show;  // presents a question
    std::function<void()> meanwhile;                                           // see meanwhile()
  };
  explicit Person(Options options) : options_(std::move(options)) {}
  // Called about ten times per second while waiting; throws to give up (a stop, an arm that left its hold).
  void meanwhile(std::function<void()> call) { options_.meanwhile = std::move(call); }

  // Waits for "go". "quit" throws Ended, anything else is refused: on a terminal it is asked again.
  void ready(const std::string& id, const std::string& text);
  bool yes(const std::string& id, const std::string& text);  // "yes" or "no"
  double number(const std::string& id, const std::string& text, double low, double high);

 private:
  std::string answer(const std::string& id, const std::string& text);
  void refuse(const std::string& id, const std::string& found, const std::string& expected) const;
  std::optional<std::string> line();  // none: the end of the input
  bool is_answered() const;           // something can be read already
  void forget_keys();

  Options options_;
  std::string rest_;  // read, and not yet a line
};

}  // namespace multipanda::commission
