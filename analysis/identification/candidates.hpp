#pragma once

#include <span>
#include <string>
#include <vector>

#include "analysis/identification/consistent_fit.hpp"

namespace multipanda {

// Models that are tried: friction laws from none to six Dahl elements between 1 and 300 mrad, each alone,
// with tilt, and with tilt and gains. Families are in the order of their number of coefficients.
struct Candidates {
  std::vector<FrictionPart> parts;  // of all of them together
  std::vector<Family> families;
};

// `table`: the robot has a friction table, so its shape is a candidate. `wanted`: only these; empty: all.
// Throws std::invalid_argument naming what there is.
Candidates candidates(bool table, const std::vector<std::string>& wanted = {});
// For a body at the flange of a known arm.
Candidates payload_candidates();

std::size_t coefficient_count(const Family& family, std::size_t joints);

// Root mean square of the residuals on the blocks left out, per joint, for every family; and fits of it.
struct CrossValidation {
  std::vector<Eigen::VectorXd> rmse;  // per family (n) [N m]
  std::vector<double> mean;           // over joints
  std::size_t chosen = 0;
  Fit fit;  // of the chosen family, all blocks
};

// Blocked cross-validation: every block is predicted by a fit to all others. `alone` are the same blocks,
// each as if it were a file of its own (equations_of with `restart`): what is predicted. Chosen is the family
// with the fewest coefficients whose mean is within 3 % or 0.003 N m of the best eligible one. `choose`
// false: the last family.
CrossValidation cross_validate(std::span<const Equations> blocks, std::span<const Equations> alone,
                               const FitProblem& problem, const Candidates& candidates, bool choose,
                               unsigned threads);

}  // namespace multipanda
