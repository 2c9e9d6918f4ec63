#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace multipanda {

// Shown after every pass of a fit by rollouts.
struct FitProgress {
  int pass = 0;                    // from 1
  double rms = 0;                  // of the weighted residual
  std::vector<std::string> names;  // of the parameters, with units
  Eigen::VectorXd value;           // in these units
  std::size_t rollouts = 0;        // simulated so far
};
// Returns false to stop; the fit so far is then the result.
using ShowProgress = std::function<bool(const FitProgress&)>;

// Residuals of many candidates at once, one column of parameters each (p x c): c vectors of equal length. A
// candidate that cannot be simulated gives an empty vector.
using BatchResiduals = std::function<std::vector<Eigen::VectorXd>(const Eigen::MatrixXd& candidates)>;

struct BatchLeastSquares {
  Eigen::VectorXd start, step;   // parameters, and their differences for the slopes (p x 1)
  Eigen::VectorXd lower, upper;  // bounds (p x 1)
  Eigen::Index cluster = 1;      // neighboring residuals that may be correlated: a window
  int passes = 15;
};

struct BatchLeastSquaresResult {
  Eigen::VectorXd x;           // (p x 1)
  Eigen::MatrixXd covariance;  // (p x p): H^-1 S H^-1, clusters taken as independent
  double rms = 0;
  int passes = 0;
  bool converged = false;
};

// Levenberg-Marquardt with central differences. Every pass simulates 2 p candidates for the slopes in one
// batch, then four step lengths in a second one. `shown` may be empty. Throws std::runtime_error if the start
// cannot be simulated.
BatchLeastSquaresResult solve(const BatchLeastSquares& problem, const BatchResiduals& residuals,
                              const std::function<bool(int pass, double rms, const Eigen::VectorXd&)>& shown);

}  // namespace multipanda
