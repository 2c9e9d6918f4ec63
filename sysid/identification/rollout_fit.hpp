#pragma once

#include <span>
#include <string>
#include <vector>

#include "scene/scene.hpp"
#include "sysid/identification/actuation.hpp"
#include "sysid/identification/batch_least_squares.hpp"
#include "sysid/measured/measured_log.hpp"

// Fits by simulation. Recorded commands are replayed from recorded states in short windows (multiple
// shooting), many candidates and windows at once on MuJoCo's thread pool, and the predictions are compared
// with the log. The scene is the log's, with the arm's current model as its plant model.
namespace multipanda {

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
  double rms = 0;                  // of the weighted residual: 1 or less if model and noise are right
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
  double height = 0, height_half95 = 0;        // of the surface above where the scene has it, outwards [m]
  double rough_stiffness = 0;                  // slope of estimated force against depth, the fit's start
  RolloutFit fit;
};
SurfaceFit fit_surface(const MeasuredLog& log, const Scene& scene, std::size_t arm, const std::string& object,
                       const RolloutOptions& options = {});

}  // namespace multipanda
