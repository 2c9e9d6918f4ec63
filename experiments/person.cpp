#include "experiments/person.hpp"

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include <fmt/format.h>

namespace multipanda {
namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r");
  return first == std::string::npos ? std::string()
                                    : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

}  // namespace

AnswerFile::AnswerFile(const std::filesystem::path& file, const std::string& experiment,
                       const std::vector<std::pair<std::string, std::string>>& arms,
                       std::function<void(const std::string&)> line)
    : file_(file), line_(std::move(line)) {
  std::ifstream in(file);
  if (!in) throw std::invalid_argument(fmt::format("the file of answers {} cannot be read", file.string()));
  std::vector<std::string> expected, found;
  for (const auto& [name, address] : arms) expected.push_back(name + "=" + address);
  std::string about;
  std::size_t number = 0;
  for (std::string text; std::getline(in, text);) {
    ++number;
    text = trimmed(text.substr(0, text.find('#')));
    if (text.empty()) continue;
    const auto space = text.find(' ');
    const std::string word = text.substr(0, space),
                      rest = space == std::string::npos ? std::string() : trimmed(text.substr(space));
    if (word == "experiment" && !rest.empty() && about.empty()) {
      about = rest;
    } else if (word == "arm" && !rest.empty()) {
      found.push_back(rest);
    } else if (word == "yes" && !rest.empty()) {
      answers_.emplace(rest, number);
    } else {
      throw std::invalid_argument(
          fmt::format("{}:{}: expected 'experiment NAME', 'arm NAME=ADDRESS' or 'yes QUESTION', found '{}'",
                      file.string(), number, text));
    }
  }
  if (about != experiment) {
    throw std::invalid_argument(
        fmt::format("{}: answers for the experiment '{}', but this is '{}'; "
                    "answers count for one experiment only",
                    file.string(), about, experiment));
  }
  std::sort(expected.begin(), expected.end());
  std::sort(found.begin(), found.end());
  if (expected != found) {
    throw std::invalid_argument(
        fmt::format("{}: answers for the arms {}, but these are {}; answers count for these arms only",
                    file.string(), fmt::join(found, ", "), fmt::join(expected, ", ")));
  }
}

bool AnswerFile::confirm(const Question& question, const std::function<bool()>& withdrawn) {
  line_(question.text);
  const auto found = answers_.find(question.key);
  if (found == answers_.end()) {
    line_(fmt::format("no answer: {} has no line 'yes {}'; add it if this is true", file_.string(),
                      question.key));
    return false;
  }
  if (withdrawn()) return false;
  line_(fmt::format("yes ({}:{})", file_.filename().string(), found->second));
  return true;
}

}  // namespace multipanda
