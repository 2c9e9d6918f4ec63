#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "experiments/experiment.hpp"
#include "runtime/session.hpp"

// Kinds of experiments: what runs them. Each kind has a page of the same name in analysis/experiments.
namespace multipanda {

inline constexpr const char* kTaskKind = "task";

struct ExperimentOptions {
  bool fast = false;                   // as fast as possible, several runs at once
  std::optional<std::size_t> repeats;  // default: the experiment's
  std::filesystem::path directory;     // for everything: logs, plots, page, results; must exist
  std::vector<std::string> only;       // variants by name or tag; empty: all
  bool keep_data = false;              // leave the arrays that the figures were made from
  BackendOptions backend;              // simulated arms: `mujoco` or `virtual_arms`
  bool ros = false;                    // kind `performance`: set-points come by ROS topics, not by the socket
};

// What the person in front sees, and how they stop it. Called from several threads, one at a time.
struct ExperimentProgress {
  std::function<void(const std::string& line)> line;
  const std::atomic<bool>* stop = nullptr;  // true: end the runs in hold, make no report
  bool stopped() const { return stop != nullptr && stop->load(std::memory_order_relaxed); }
};

struct ExperimentResult {
  std::string name;
  bool stopped = false;
  bool passed = false;                // every limit held and every run went as asked
  std::filesystem::path page;         // report.html
  nlohmann::ordered_json results;     // as results.json, docs/experiments.md
  std::vector<std::string> problems;  // why not passed, one sentence each
};

struct ExperimentKind {
  std::string name;
  std::string doc;
  // Off the loop. Throws std::invalid_argument (an experiment that cannot be) before anything moves, and
  // std::runtime_error.
  ExperimentResult (*run)(const Experiment&, const ExperimentOptions&, const ExperimentProgress&);
};

const std::vector<ExperimentKind>& experiment_kinds();
const ExperimentKind* find_kind(const std::string& name);  // nullptr: none
std::vector<std::string> kind_names();

// Runs it with the runner of its kind.
ExperimentResult run_experiment(const Experiment& experiment, const ExperimentOptions& options,
                                const ExperimentProgress& progress);

// Every variant on every plant, so many times, each in a session of its own; then the page.
ExperimentResult run_task(const Experiment& experiment, const ExperimentOptions& options,
                          const ExperimentProgress& progress);

// Conditions one after the other, each in a session of its own, paced; then switching (performance_runs.hpp).
ExperimentResult run_performance(const Experiment& experiment, const ExperimentOptions& options,
                                 const ExperimentProgress& progress);

// --- for the runners of kinds ---

// What the page needs of the experiment itself: title, limits, published figures, machine, ...
nlohmann::ordered_json describe(const Experiment& experiment);
// Writes `plan` beside the data, lets analysis/experiments make figures, verdicts and page from it, and reads
// them back. Throws std::runtime_error with what the script said.
ExperimentResult evaluate(const Experiment& experiment, const nlohmann::ordered_json& plan,
                          const ExperimentOptions& options);
// One page about several experiments, in `directory`; its path.
std::filesystem::path make_index(const std::vector<ExperimentResult>& results,
                                 const std::filesystem::path& directory);

}  // namespace multipanda
