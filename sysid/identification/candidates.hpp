#pragma once

#include <span>
#include <string>
#include <vector>

#include "sysid/identification/consistent_fit.hpp"

namespace multipanda {

// Candidate models: friction laws from none to six Dahl elements between 1 and 300 mrad, each alone, with
// tilt, and with tilt and gains. Families are ordered by their number of coefficients.
struct Candidates {
  std::vector<FrictionPart> parts;  // of all families together
  std::vector<Family> families;
};

// `table`: the robot has a friction table, whose shape is then a candidate. `requested`: only these; empty:
// all. `one_base` false: one tilt cannot hold for all logs, so no family has it. Throws std::invalid_argument
// listing the known names.
Candidates candidates(bool table, const std::vector<std::string>& requested = {}, bool one_base = true);
// Families for a body at the flange of a known arm.
Candidates payload_candidates();

std::size_t coefficient_count(const Family& family, std::size_t joints);

// RMS of the residuals on the held-out blocks, per joint, for every family.
struct CrossValidation {
  std::vector<Eigen::VectorXd> rmse;  // per family (n) [N m]
  std::vector<double> mean;           // over joints
  std::size_t chosen = 0, folds = 0;
  Fit fit;  // of the chosen family, all blocks
};

// Expected RMS residual on other motion, from that on the held-out blocks, `validated`, and that on the
// fitted rows, `fitted` (n x 1 each). A fit without a block has only (folds - 1) / folds of the rows, and the
// excess over the error on fitted rows is inversely proportional to their number:
//   expected^2 = fitted^2 + (folds - 1) / folds (validated^2 - fitted^2)
Eigen::VectorXd expected_rmse(const Eigen::VectorXd& validated, const Eigen::VectorXd& fitted,
                              std::size_t folds);

// The same for one family, fitted to these blocks.
struct Expected {
  Fit fit;  // all blocks
  Eigen::VectorXd rmse;
};
Expected fit_and_expect(std::span<const Equations> blocks, std::span<const Equations> alone,
                        const FitProblem& problem, const Family& family);

// Blocked cross-validation: every block is predicted by a fit to all others. `alone` has the same blocks,
// each as a separate file (equations_of with `restart`); these are predicted. The choice is the family with
// the fewest coefficients whose mean is within 3 % or 0.003 N m of the best eligible one. `choose` false: the
// last family.
CrossValidation cross_validate(std::span<const Equations> blocks, std::span<const Equations> alone,
                               const FitProblem& problem, const Candidates& candidates, bool choose,
                               unsigned threads);

}  // namespace multipanda
