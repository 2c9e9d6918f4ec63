#pragma once

#include <span>
#include <string>
#include <vector>

#include "sysid/identification/consistent_fit.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/inertial_parameters.hpp"

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

// Steps that identify() and its payload mode share; for internal use only.

// Lower bound on the eigenvalues of a prior's second moment: the parameters of a nearly flat link would
// hardly change.
inline constexpr double kLeastSecondMoment = 1e-3;  // [kg m^2]

struct FilteredLogs {
  std::vector<FilteredLog> logs;
  double seconds = 0;
};
// Throws LogRefused: no logs, too short, another robot.
FilteredLogs filtered_logs(std::span<const MeasuredLog> logs, const RobotDescription& prior);

void put_scores(const CrossValidation& validation, const Candidates& candidates, std::size_t joints,
                bool choose, Identification& out);

// Train and test by time: the first part of every log is fitted and the rest predicted as a separate log; for
// `out.cuts` also with other shares and in reverse order.
void put_held_out(std::span<const MeasuredLog> logs, const EquationSource& source, FitProblem problem,
                  const Family& family, std::size_t folds, const std::function<void(FilteredLog&)>& prepare,
                  Identification& out);

// Describes the motion: ranges, repetition.
void put_motion(std::span<const FilteredLog> logs, Identification& out);

// Predictions of all models on all logs: rmse_all, series, other models of the same kinematics.
void put_predictions(std::span<const FilteredLog> logs, const RobotDescription& prior,
                     const IdentifyOptions& options, Identification& out);

// `options` names the known bodies of the arm: hand and tool.
Identification identify_payload(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                                const IdentifyOptions& options);

// Refusals of data that do not support an identification, each with the decisive figure.

// Throws LogRefused for another joint count and for positions outside the range of `robot`.
void refuse_other_robot(std::span<const MeasuredLog> logs, const RobotDescription& robot);

// Throws LogRefused if the given robot leaves most of the torque of a log unexplained: another robot or base,
// other units, or another order of the joints. `theta` (10 n) has hand and tool.
void refuse_unexplained(const std::string& source, const Equations& equations, const Eigen::VectorXd& theta,
                        const RobotDescription& robot);

// Condition of the regressor's `leading` columns in these equations.
Condition condition_of(const Equations& equations, const std::vector<Eigen::Index>& leading);

// Throws LogRefused if the columns cannot be distinguished; adds to `warnings` if they hardly can.
void refuse_unexciting(const Condition& condition, std::vector<std::string>& warnings);

}  // namespace multipanda
