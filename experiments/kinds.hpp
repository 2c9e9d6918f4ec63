#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/person.hpp"
#include "experiments/experiment.hpp"
#include "runtime/session.hpp"

// Kinds of experiments and their runners. Each kind has a page of the same name in experiments/pages.
namespace multipanda {

inline constexpr const char* kTaskKind = "task";

struct ExperimentOptions {
  bool fast = false;                   // as fast as possible, several runs at once
  std::optional<std::size_t> repeats;  // default: as in the experiment
  std::filesystem::path directory;     // existing folder for logs, plots, page and results
  std::vector<std::string> only;       // variants by name or tag; empty: all
  bool keep_data = false;              // keep the arrays from which the figures are computed
  BackendOptions backend;              // `mujoco`, `virtual_arms`, or `fci`: arms that are not simulated here
  // Confirms every step of an experiment with `fci`; required there, unused otherwise.
  Person* person = nullptr;
  // Logs of arms to show beside simulated runs (on_arms.hpp); kind `performance`: measurements inside a
  // controller_manager (beside_trace.hpp).
  std::vector<std::string> beside;
  bool resume = false;              // continue the interrupted experiment in `directory`: only missing runs
  SessionViewer* viewer = nullptr;  // displays one run at a time, except unpaced checks; may be none
  bool ros = false;                 // kind `performance`: set-points come by ROS topics instead of the socket
};

// Progress lines for the user, and the request to stop. Called from several threads, one at a time.
struct ExperimentProgress {
  std::function<void(const std::string& line)> line;
  const std::atomic<bool>* stop = nullptr;  // true: end the runs in hold, without a report
  // Checked before a run and again once it is displayed: Stop may have been pressed meanwhile.
  bool stopped() const { return stop != nullptr && stop->load(std::memory_order_relaxed); }
};

struct ExperimentResult {
  std::string name;
  bool stopped = false;
  std::string why_stopped;            // reason why an experiment on arms ended; empty: on request
  bool passed = false;                // every limit held and every run completed
  std::filesystem::path page;         // report.html
  nlohmann::ordered_json results;     // as results.json, docs/experiments.md
  std::vector<std::string> problems;  // reasons for not passing, one sentence each
};

struct ExperimentKind {
  std::string name;
  std::string doc;
  std::vector<std::string> metrics;  // metrics of its page, which limits may name
  // Throws std::invalid_argument for an invalid experiment before anything moves, and std::runtime_error if a
  // run fails.
  ExperimentResult (*run)(const Experiment&, const ExperimentOptions&, const ExperimentProgress&);
};

const std::vector<ExperimentKind>& experiment_kinds();
const ExperimentKind* find_kind(const std::string& name);  // nullptr if there is none
std::vector<std::string> kind_names();

// Runs an experiment with the runner of its kind.
ExperimentResult run_experiment(const Experiment& experiment, const ExperimentOptions& options,
                                const ExperimentProgress& progress);

// Runs every variant on every plant, repeatedly, each in its own session. Then makes the page.
ExperimentResult run_task(const Experiment& experiment, const ExperimentOptions& options,
                          const ExperimentProgress& progress);

// Runs the conditions in order, paced, each in its own session. Then measures switching
// (performance_runs.hpp).
ExperimentResult run_performance(const Experiment& experiment, const ExperimentOptions& options,
                                 const ExperimentProgress& progress);

// The experiment's part of the page's data: title, limits, published figures, machine, ...
nlohmann::ordered_json describe(const Experiment& experiment);
// Writes `plan` next to the data, runs experiments/pages to make figures, verdicts and page, and reads the
// results. Throws std::runtime_error with the script's messages.
ExperimentResult evaluate(const Experiment& experiment, const nlohmann::ordered_json& plan,
                          const ExperimentOptions& options);
// Makes one page about several experiments in `directory` and returns its path.
std::filesystem::path make_index(const std::vector<ExperimentResult>& results,
                                 const std::filesystem::path& directory);

}  // namespace multipanda
