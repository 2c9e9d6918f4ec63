#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "analysis/comparison/align.hpp"

// How far a simulation is from what was measured, for one arm and all repeats of a task (docs/compare.md).
namespace multipanda {

struct CompareOptions : AlignOptions {
  double rest_s = 2.0;  // noise floor: at most this much of the real log's first rest
};

// One quantity over all pairs of repeats.
struct QuantityFigures {
  std::string name, what, unit;
  std::vector<std::string> axes;  // "1".."7", or "x", "y", "z"
  std::string missing;            // why there are no figures; empty: there are
  Eigen::MatrixXd rmse, max;      // root of the mean square, and largest absolute error (pairs x axes)
  Eigen::VectorXd noise;          // standard deviation at rest (axes), mean over repeats; empty: no rest
  double paper = 0;               // the paper's largest; 0: none

  bool available() const { return missing.empty(); }
  // The one figure per quantity that the paper's bars show: mean over axes of the RMSE, then over repeats.
  double mean() const;
  double spread() const;   // standard deviation over repeats of the mean over axes; 0 for a single one
  double largest() const;  // absolute error on any axis in any repeat
  std::optional<double> noise_floor() const;  // mean over axes
  Eigen::VectorXd axis_mean() const;          // over repeats (axes)
  Eigen::VectorXd axis_spread() const;        // over repeats (axes)
};

struct Comparison {
  std::string arm;                          // empty: the logs have no name for it
  std::vector<QuantityFigures> quantities;  // in the order of quantities()
  struct Pair {
    std::string real, sim;
    double lag_s = 0, correlation = 0, from_s = 0, to_s = 0;  // from, to: since the real log's start
    std::optional<double> measured_lag_s;                     // see AlignedPair
    std::string aligned_by;
  };
  std::vector<Pair> pairs;
  double low_pass_hz = 0;  // of the series compared; 0: as measured
  double rest_s = 0;       // the noise floor is of so long a rest, the shortest of the repeats; 0: none
  std::vector<std::string> warnings;

  // Throws std::invalid_argument if there is no such quantity.
  const QuantityFigures& at(const std::string& name) const;
};

// Repeat i of the real logs against repeat i of the simulated ones; where one side has a single log, that one
// against each of the other. Throws LogRefused (see align) and std::invalid_argument for no logs.
Comparison compare(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                   const CompareOptions& options = {});

// The same tasks before and after something was changed in the simulation.
struct QuantityChange {
  std::string name, unit;
  double before = 0, after = 0;  // QuantityFigures::mean
  double spread = 0;             // the larger of the two spreads over repeats
  double ratio = 0;              // after / before; 1 where both are 0
  bool worse = false;            // after - before > 2 spread (and more than rounding)
};
// Quantities that both comparisons have.
std::vector<QuantityChange> change(const Comparison& before, const Comparison& after);

nlohmann::ordered_json to_json(const Comparison& comparison);
nlohmann::ordered_json to_json(const std::vector<QuantityChange>& changes);

}  // namespace multipanda
