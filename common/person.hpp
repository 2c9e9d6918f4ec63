#pragma once

#include <functional>
#include <optional>
#include <stdexcept>
#include <string>

namespace multipanda {

// The person beside the arms, who is asked before anything moves. Without an answer the members throw Ended;
// nothing is assumed.
//
// Answers come as lines from a file descriptor: a terminal (an empty line is "go"), or with `named` a file or
// pipe whose lines are "ID: answer", in the order of the questions; an answer to another question is refused.
class Person {
 public:
  // The person stopped, or no further answers can come.
  struct Ended : std::runtime_error {
    using std::runtime_error::runtime_error;
  };
  struct Options {
    int file = 0;        // descriptor to read from
    bool named = false;  // lines name their question
    // With `named`: whether an answer may arrive before its question. For virtual arms only, because its
    // author has not seen the arm.
    bool early = false;
    std::string source;  // for messages: "the answers of answers.txt"
    std::function<void(const std::string& id, const std::string& text)> show;  // presents a question
    std::function<void(const std::string& text)> prompt;  // shows the expected answers; without newline
  };
  // The source that a command's `--answers` names: a file or pipe, "-" for standard input, "" for the
  // terminal. Throws std::invalid_argument if it cannot be opened, or if this program is not in the
  // foreground of a terminal.
  static Options source(const std::string& answers);

  explicit Person(Options options) : options_(std::move(options)) {}
  // Called about ten times per second while waiting, and once more after the answer; may throw to cancel (a
  // stop, an arm that left its hold).
  void meanwhile(std::function<void()> call) { meanwhile_ = std::move(call); }

  // Waits for "go". "quit" throws Ended; other answers are refused, on a terminal with another question.
  void ready(const std::string& id, const std::string& text);
  bool yes(const std::string& id, const std::string& text);  // "yes" or "no"
  double number(const std::string& id, const std::string& text, double low, double high);

 private:
  std::string answer(const std::string& id, const std::string& text, const std::string& choices);
  void refuse(const std::string& id, const std::string& found, const std::string& expected) const;
  std::optional<std::string> line();     // none: the end of the input
  short wait_for_input(int timeout_ms);  // result of poll(); 0: nothing yet
  void forget_keys();

  Options options_;
  std::function<void()> meanwhile_ = [] {};
  std::string rest_;  // read, but not yet a line
};

}  // namespace multipanda
