#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "analysis/identification/linear_fit.hpp"
#include "analysis/measured/measured_log.hpp"
#include "models/robot_description.hpp"

// From logs to the model of one arm: inertial parameters that some rigid bodies have, friction beyond the
// torque sensor, the sensor's gains and offsets, tilt of the base (docs/identification.md has the method).
namespace multipanda {

struct IdentifyOptions {
  bool payload = false;               // the arm is as the prior says; only a body at the flange is sought
  bool hand = false;                  // the prior's hand is on the flange
  std::optional<RigidBody> tool;      // known body in the flange's frame, beside the hand
  Vector3 gravity_B{0, 0, -9.81};     // in the base as it is believed to stand [m/s^2]
  std::vector<std::string> families;  // only these candidates (family_names()); empty: all
  bool choose = true;                 // false: the last of `families`, without cross-validation
  std::size_t folds = 6;              // blocks of cross-validation; the last third of them is held out
  double prior_weight = 1e-3;         // of the distance to the prior (lambda)
  unsigned threads = 2;
};

// One candidate in the blocked cross-validation.
struct FamilyScore {
  std::string name;
  std::size_t coefficients = 0;  // beside the inertial parameters
  JointVector rmse;              // on the blocks left out [N m] (n x 1)
  double mean = 0;               // over joints
  bool eligible = true;          // false: shown for comparison only
  bool chosen = false;
};

// Train and test by time: a part of every log is fitted, the rest predicted as if it were a log of its own.
struct TimeCut {
  double from = 0, to = 0;            // share of the time that was fitted; the rest is the test
  JointVector rmse_train, rmse_test;  // [N m] (n x 1)
};

// Another model's prediction of the same data by the same protocol.
struct ModelBeside {
  std::string name;
  JointVector rmse;  // [N m] (n x 1)
  double mean = 0;
};

// Measured and predicted torque at the protocol's samples, for pages.
struct ResidualSeries {
  std::string source;
  Eigen::VectorXd t;                           // [s] (N)
  Eigen::MatrixXd measured, predicted, prior;  // [N m] (N x n)
};

struct Identification {
  RobotDescription robot;            // the prior with what was found; fitted to all data
  std::optional<RigidBody> payload;  // in the flange's frame; `robot`'s last link holds it too
  double payload_mass_half95 = 0;    // [kg]
  double payload_com_half95 = 0;     // along the worst axis of the last link [m]

  std::string family;                  // chosen
  std::vector<FamilyScore> scores;     // simplest first
  std::vector<TimeCut> cuts;           // the chosen family fitted to a part of every log, tested on the rest
  JointVector rmse_train;              // of the first cut, on what it was fitted to [N m] (n x 1)
  JointVector rmse_heldout;            // of the first cut, on the rest
  JointVector rmse_all;                // of `robot` on everything it was fitted to
  bool consistent = false;             // every moving link has a positive definite pseudo-inertia
  bool dissipative = false;            // no friction amplitude is negative
  std::vector<bool> prior_consistent;  // per moving link, of the prior as given

  LinearFit linear;  // base parameters and coefficients with intervals
  std::vector<ModelBeside> beside;
  std::vector<ResidualSeries> series;
  double seconds_used = 0;  // of data
  std::vector<std::string> warnings;
};

// Any thread; takes seconds. Throws LogRefused: too short, not exciting (with the condition number), another
// robot than `prior` (joint count, positions outside its range, torques that it does not explain);
// std::invalid_argument: unknown family, a hand that the prior does not have.
Identification identify(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                        const IdentifyOptions& options = {});

// Names that IdentifyOptions::families knows, simplest first.
std::vector<std::string> family_names();

}  // namespace multipanda
