#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "scene/scene.hpp"
#include "sysid/identification/actuation.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// Progress after every pass of a fit by rollouts.
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
  Eigen::Index cluster = 1;      // number of neighboring residuals that may be correlated: a window
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

// Fits by simulation. Recorded commands are replayed from recorded states in short windows (multiple
// shooting), many candidates and windows at once on MuJoCo's thread pool, and the predictions are compared
// with the log. The scene is the log's, with the arm's current model as its plant model.

struct RolloutOptions {
  double window = 0.05;       // length of a rollout [s]
  std::size_t windows = 160;  // at most, spread evenly over all logs
  int threads = 0;            // 0: one per core
  int passes = 12;
  ShowProgress progress;  // after every pass
};

struct RolloutFit {
  std::vector<std::string> names;  // of the parameters, with units
  Eigen::VectorXd value, half95;   // the truth lies within value +- half95 with 95 %
  double rms = 0;                  // of the weighted residual: at most 1 if model and noise are right
  int passes = 0;
  bool converged = false;
  std::size_t windows = 0, rollouts = 0;
  std::vector<std::string> warnings;
};

// Delay and torque bandwidth, from q, dq and tau_J together. Unlike fit_actuation it uses the effect of the
// torque on the arm. `start`: result of fit_actuation with the plant model as prior; its friction scale and
// offsets are kept. Residuals of each joint and quantity are weighted by their own spread at the start, so
// that a wrong mass has little weight. Throws LogRefused as fit_actuation does, and std::invalid_argument if
// the scene cannot be built.
struct ActuationRollouts {
  Actuation actuation;
  RolloutFit fit;  // delay [ms], time constant [ms]
};
ActuationRollouts fit_actuation_by_rollouts(std::span<const MeasuredLog> logs, const Scene& scene,
                                            std::size_t arm, const ActuationFit& start,
                                            const RolloutOptions& options = {});

// Stiffness of a surface, from a log in which a tool shape presses on it with a changing force. The object's
// height along the contact's normal is fitted too, because only the change of force with depth is
// informative. The residual is the tool's distance from the surface, predicted against measured; the measured
// torque acts. Limits: a fast sliding tool and a compliant arm (real joints: about 1e4 N m/rad, 50 to 100
// kN/m at the hand) look like a softer surface. Throws LogRefused without contact or with a constant force;
// std::invalid_argument for an unknown object, an arm without tool shapes, or an object without `contact`.
struct SurfaceFit {
  double stiffness = 0, stiffness_half95 = 0;  // [N/m]
  double height = 0, height_half95 = 0;        // offset of the surface from its place in the scene, outwards
                                               // [m]
  double rough_stiffness = 0;                  // slope of estimated force against depth, the fit's start
  RolloutFit fit;
};
SurfaceFit fit_surface(const MeasuredLog& log, const Scene& scene, std::size_t arm, const std::string& object,
                       const RolloutOptions& options = {});

}  // namespace multipanda
