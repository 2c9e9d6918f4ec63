#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

// The person beside the arms, who confirms every step of an experiment before anything moves.
namespace multipanda {

struct Question {
  std::string key;   // the same step of every experiment has the same: "clear", "place table"
  std::string text;  // what is asked, or what will move, and how far and fast; may have several lines
};

class Person {
 public:
  virtual ~Person() = default;
  // True only after an explicit yes to this question. False: stop the experiment. `withdrawn` is asked about
  // ten times per second; as soon as it is true the answer is false: an arm stopped itself, or the user did.
  virtual bool confirm(const Question& question, const std::function<bool()>& withdrawn) = 0;
};

// Answers from a file, for tests on virtual arms (docs/experiments.md). One answer per line:
//   experiment task-3
//   arm arm=127.0.0.5        once per arm
//   yes clear                once per question, by its key
// A question without its line is answered with no, and the reason says which line is missing.
class AnswerFile final : public Person {
 public:
  // Throws std::invalid_argument with file and line for anything else than such lines, and if the file is
  // about another experiment or other arms.
  AnswerFile(const std::filesystem::path& file, const std::string& experiment,
             const std::vector<std::pair<std::string, std::string>>& arms,
             std::function<void(const std::string&)> line);

  bool confirm(const Question& question, const std::function<bool()>& withdrawn) override;

 private:
  std::filesystem::path file_;
  std::map<std::string, std::size_t> answers_;  // line numbers by key
  std::function<void(const std::string&)> line_;
};

}  // namespace multipanda
