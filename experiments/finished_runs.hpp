#pragma once

#include <filesystem>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "experiments/kinds.hpp"

namespace multipanda {

// What decides what the runs of an experiment are, besides their `scenes` (texts of all of them): the
// experiment without what only its page shows, the backend and the addresses.
nlohmann::ordered_json what_decides(const Experiment& experiment, const ExperimentOptions& options,
                                    const std::string& scenes);

// The finished runs of an experiment, kept in its folder so that an interrupted experiment can be resumed.
// One thread at a time.
class FinishedRuns {
 public:
  // `what`: of what_decides(). `resume`: reads what is
  // finished; otherwise begins again. Throws std::invalid_argument if the folder has nothing to resume, or
  // was begun with a different `what`; the message names the first key that differs.
  FinishedRuns(std::filesystem::path folder, nlohmann::ordered_json what, bool resume);

  const nlohmann::ordered_json* find(const std::string& run) const;  // nullptr: not finished
  void add(const std::string& run, const nlohmann::ordered_json& record);
  void remove_file() const;  // the page is made: nothing is left to resume
  std::size_t count() const { return runs_.size(); }

 private:
  std::filesystem::path file_;
  nlohmann::ordered_json what_;
  std::map<std::string, nlohmann::ordered_json> runs_;
};

}  // namespace multipanda
