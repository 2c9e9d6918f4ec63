#pragma once

#include <span>
#include <string>
#include <vector>

#include "sysid/identification/candidates.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/inertial_parameters.hpp"

// Steps that identify() and its payload mode share; for internal use only.
namespace multipanda {

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
