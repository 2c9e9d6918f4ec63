#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "sysid/comparison/align.hpp"

// Distance between a simulation and a measurement, for one arm and all repeats of a task
// (docs/identification.md).
namespace multipanda {

struct CompareOptions : AlignOptions {
  double rest_s = 2.0;  // noise floor: at most this much of the real log's first rest is used [s]
};

// One quantity over all pairs of repeats.
struct QuantityFigures {
  std::string name, what, unit;
  std::vector<std::string> axes;  // "1".."7", or "x", "y", "z"
  std::string missing;            // why there are no figures; empty: there are figures
  Eigen::MatrixXd rmse, max;      // root of the mean square, and largest absolute error (pairs x axes)
  Eigen::VectorXd noise;          // standard deviation at rest (axes), mean over repeats; empty: no rest
  double paper = 0;               // largest value in the paper; 0: none

  bool available() const { return missing.empty(); }
  // The paper's single figure per quantity: RMSE, mean over axes, then over repeats.
  double mean() const;
  double spread() const;   // standard deviation over repeats of the mean over axes; 0 for a single repeat
  double largest() const;  // absolute error on any axis in any repeat
  std::optional<double> noise_floor() const;  // mean over axes
  Eigen::VectorXd axis_mean() const;          // over repeats (axes)
  Eigen::VectorXd axis_spread() const;        // over repeats (axes)
};

struct Comparison {
  std::string arm;                          // empty: unnamed in the logs
  std::vector<QuantityFigures> quantities;  // in the order of quantities()
  struct Pair {
    std::string real, sim;
    double lag_s = 0, correlation = 0, from_s = 0, to_s = 0;  // from, to: since the real log's start
    std::optional<double> measured_lag_s;                     // see AlignedPair
    std::string aligned_by;
  };
  std::vector<Pair> pairs;
  double low_pass_hz = 0;  // of the series compared; 0: as measured
  double rest_s = 0;  // duration of the rest behind the noise floor, the shortest of the repeats; 0: no rest
  std::vector<std::string> warnings;

  // Throws std::invalid_argument for an unknown quantity.
  const QuantityFigures& at(const std::string& name) const;
};

// Compares repeat i of the real logs with repeat i of the simulated ones. A single log is compared with each
// log of the other side. Throws LogRefused (see align), and std::invalid_argument if there are no logs.
Comparison compare(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                   const CompareOptions& options = {});

// Change of a quantity between two comparisons, before and after the simulation was changed.
struct QuantityChange {
  std::string name, unit;
  double before = 0, after = 0;  // QuantityFigures::mean
  double spread = 0;             // the larger of the two spreads over repeats
  double ratio = 0;              // after / before; 1 where both are 0
  bool worse = false;            // after - before > 2 spread (and more than rounding)
};
// One entry for each quantity that both comparisons have.
std::vector<QuantityChange> change(const Comparison& before, const Comparison& after);

nlohmann::ordered_json to_json(const Comparison& comparison);
nlohmann::ordered_json to_json(const std::vector<QuantityChange>& changes);

// Limits of a comparison, for use in CI. A YAML file:
//   F_EE: {rmse: 1.7, max: 10}     # rmse: mean over axes and repeats; max: any axis of any repeat
//   q: {rmse: 0.06, axis: 0.1}     # axis: mean over repeats of the worst axis
//   lag_s: 0.02                    # of any repeat, in either direction
//   arms: {left: {tau: {rmse: 1}}} # for one arm, in place of the limits above

struct GateLimit {
  std::string quantity;  // "F_EE", or "lag_s"
  std::string figure;    // "rmse", "axis", "max"; empty for lag_s
  double limit = 0;
  std::string place;  // "gate.yaml:3"
};

struct Gate {
  std::vector<GateLimit> limits;
  std::map<std::string, std::vector<GateLimit>> of_arm;  // in place of the same limits above
};

// Throws std::invalid_argument with file and line.
Gate read_gate(const std::filesystem::path& path);

struct GateResult {
  GateLimit limit;
  std::string arm, axis;        // axis that exceeds the limit; may be empty
  std::optional<double> found;  // none: the logs lack the quantity, which violates the limit
  bool held = false;
  std::string text;  // one human-readable sentence
};
std::vector<GateResult> check_gate(const Gate& gate, const Comparison& comparison);

struct ComparedArm {
  Comparison comparison;
  AlignedPair shown;             // repeat that is drawn
  std::vector<GateResult> gate;  // empty: no limits
};

// Everything as JSON: "real", "sim", "passed", "arms" (to_json of each, with "gate").
nlohmann::ordered_json comparison_results(const std::string& real, const std::string& sim,
                                          std::span<const ComparedArm> arms);

// Writes results.json, the plots and report.html into the folder, which is created. Returns the path of the
// page. Throws std::runtime_error with the script's output if it fails.
std::filesystem::path make_comparison_page(const std::filesystem::path& folder,
                                           const nlohmann::ordered_json& results,
                                           std::span<const ComparedArm> arms);

}  // namespace multipanda
