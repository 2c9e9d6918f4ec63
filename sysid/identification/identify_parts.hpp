#pragma once

#include <span>
#include <vector>

#include "sysid/identification/candidates.hpp"
#include "sysid/identification/identify.hpp"

// Steps that identify() and its payload mode share; for internal use only.
namespace multipanda {

// Smallest eigenvalue of a prior's second moment: the parameters of a nearly flat link would hardly change.
inline constexpr double kLeastSecondMoment = 1e-3;  // [kg m^2]

struct FilteredLogs {
  std::vector<FilteredLog> logs;
  double seconds = 0;
};
// Throws LogRefused: no logs, too short, another robot.
FilteredLogs filtered_logs(std::span<const MeasuredLog> logs, const RobotDescription& prior);

void put_scores(const CrossValidation& validation, const Candidates& candidates, std::size_t joints,
                bool choose, Identification& out);

// Train and test by time, with files that are actually cut. The first part of every log is fitted, the rest
// predicted as a log of its own, and for `out.cuts` also with other shares and in reverse order.
void put_held_out(std::span<const MeasuredLog> logs, const EquationSource& source, const FitProblem& problem,
                  const Family& family, std::size_t folds, const std::function<void(FilteredLog&)>& prepare,
                  Identification& out);

// What the motion was: ranges, repetition.
void put_motion(std::span<const FilteredLog> logs, Identification& out);

// Predictions of all models on all logs: rmse_all, series, other models of the same kinematics.
void put_predictions(std::span<const FilteredLog> logs, const RobotDescription& prior,
                     const IdentifyOptions& options, Identification& out);

// `options` names the known bodies of the arm: hand and tool.
Identification identify_payload(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                                const IdentifyOptions& options);

}  // namespace multipanda
