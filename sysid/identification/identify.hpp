#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/inertial_parameters.hpp"
#include "sysid/measured/measured_log.hpp"

// The linear stage by itself: least squares on base parameters and friction amplitudes, without prior,
// consistency or bounds, with intervals that allow for correlated residuals.
namespace multipanda {

// States and torques of one arm at evenly spaced samples, exact or filtered.
struct MotionData {
  Eigen::MatrixXd q, dq, ddq;  // [rad, rad/s, rad/s^2] (N x n)
  Eigen::MatrixXd tau;         // [N m] (N x n)
  // One (N x n) for each requested friction part, in the order of LinearOptions::friction. Empty: none.
  std::vector<Eigen::MatrixXd> friction;
  std::optional<Vector3> gravity_B;  // in its base [m/s^2]; none: LinearOptions::gravity_B
};

struct LinearOptions {
  // In addition to the rigid body; {} for simulated arms, whose tau has no such friction.
  std::vector<FrictionPart> friction;
  bool hand = false;               // the robot's hand is on the flange
  std::optional<RigidBody> tool;   // known body in the flange's frame, in addition to the hand
  Vector3 gravity_B{0, 0, -9.81};  // in the base, for data without their own [m/s^2]
  bool body_only = false;          // the links are known: only ten parameters of a body on the last link
  int passes = 3;                  // of weighting the joints by the spread of their residuals
};

struct LinearFit {
  BaseParameters base;             // the r identifiable combinations
  std::vector<std::string> names;  // of every value
  std::vector<std::string> units;  // of every value: "kg m^2"
  Eigen::VectorXd value;           // r base parameters, then for joint 1, 2, ... its friction amplitudes
  Eigen::MatrixXd covariance;      // of `value`
  Eigen::VectorXd half95;          // the true value lies within value +- half95 with 95 %
  Condition condition;             // of the base parameters' regressor on these data
  JointVector rmse;                // [N m] (n x 1)
  Eigen::Index longest_lag = 0;    // samples over which residuals are significantly correlated
};

// Takes base tilt and sensor gains of `robot` as known, and theta for the effect of tilt; not its friction.
// All data have the same sample period.
LinearFit fit_linear(std::span<const MotionData> data, const RobotDescription& robot,
                     const LinearOptions& options = {});

// The same after the protocol's filters. Throws LogRefused if a log is too short.
LinearFit fit_linear(std::span<const MeasuredLog> logs, const RobotDescription& robot,
                     const LinearOptions& options = {});

// From logs to the model of one arm: inertial parameters of physically possible bodies, friction beyond the
// torque sensor, gains and offsets of the sensor, tilt of the base (docs/identification.md has the method).

struct IdentifyOptions {
  bool payload = false;               // the prior describes the arm; only a body at the flange is identified
  bool hand = false;                  // the prior's hand is on the flange
  std::optional<RigidBody> tool;      // known body in the flange's frame, in addition to the hand
  Vector3 gravity_B{0, 0, -9.81};     // in the base, for logs without their own (MeasuredLog) [m/s^2]
  std::vector<std::string> families;  // only these candidates (family_names()); empty: all
  bool choose = true;                 // false: the last of `families`, without cross-validation
  std::size_t folds = 3;              // blocks of cross-validation
  double prior_weight = 1e-2;         // of the distance to the prior (lambda)
  unsigned threads = 2;
};

// Score of one candidate on the held-out blocks.
struct FamilyScore {
  std::string name;
  std::size_t coefficients = 0;  // in addition to the inertial parameters
  JointVector rmse;              // on the blocks left out [N m] (n x 1)
  double mean = 0;               // over joints
  bool eligible = true;          // false: only for comparison
  bool chosen = false;
};

// Train and test by time: a part of every log is fitted, the rest is predicted as a separate log.
struct TimeCut {
  double from = 0, to = 0;            // fraction of the time that is fitted; the rest is the test
  JointVector rmse_train, rmse_test;  // [N m] (n x 1)
  JointVector rmse_expected;          // of the test, from the fitted part alone (expected_rmse) [N m] (n x 1)
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
  RobotDescription robot;            // the prior with the identified values, fitted to all data
  std::optional<RigidBody> payload;  // in the flange's frame; the last link of `robot` contains it too
  double payload_mass_half95 = 0;    // [kg]
  double payload_com_half95 = 0;     // along the worst axis of the last link [m]

  std::string family;               // chosen
  std::vector<FamilyScore> scores;  // simplest first
  std::vector<TimeCut> cuts;        // the chosen family, fitted to a part of every log and tested on the rest
  // Expected residual on similar motion that is not fitted (expected_rmse) [N m] (n x 1); or empty.
  JointVector rmse_expected;
  Eigen::VectorXd q_min, q_max, dq_max;  // ranges of the motion, for which `rmse_expected` holds [rad, rad/s]
                                         // (n x 1)
  std::vector<double> repeated_after;    // per log: period of a repetitive motion [s]; 0: not repetitive
  JointVector rmse_train;                // of the first cut, on the fitted part [N m] (n x 1)
  JointVector rmse_heldout;              // of the first cut, on the rest
  JointVector rmse_all;                  // of `robot` on all data that it was fitted to
  bool consistent = false;               // every moving link has a positive definite pseudo-inertia
  bool dissipative = false;              // no friction amplitude is negative
  std::vector<bool> prior_consistent;    // per moving link, of the prior as given

  LinearFit linear;  // base parameters and coefficients with intervals
  std::vector<ModelBeside> beside;
  std::vector<ResidualSeries> series;
  double seconds_used = 0;  // of data
  std::vector<std::string> warnings;
};

// Any thread; takes seconds. Throws LogRefused for data that are too short or not exciting (with the
// condition number), and for another robot than `prior` (joint count, positions outside its range, torques
// that it does not explain). Throws std::invalid_argument for an unknown family, and for a hand that the
// prior does not have.
Identification identify(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                        const IdentifyOptions& options = {});

// Names that IdentifyOptions::families accepts, simplest first.
std::vector<std::string> family_names();

// Load and mounting of an arm according to the scene in its log, or (base only) to the log itself.
struct Mounting {
  bool hand = false;
  std::optional<RigidBody> tool;  // tool and declared load of the scene, in the flange's frame
  std::optional<RigidBody> tool_without_load;
  Vector3 gravity_B{0, 0, -9.81};  // [m/s^2]
  bool told = false;               // the log has a scene
  bool base_told = false;          // gravity_B is from the scene, the log or an option; otherwise: level
};

// Throws std::runtime_error or std::invalid_argument if the scene cannot be rebuilt or has no such arm.
Mounting mounting_of(const MeasuredLog& log);

// Bases that turn gravity by less than a degree against each other count as one.
bool same_gravity(const Vector3& a, const Vector3& b);

// Text for a base: "gravity along (0.00, 0.00, -1.00) of its base".
std::string in_words(const Mounting& mounting);

// Throws LogRefused if logs cannot be combined: with and without hand, with different tools, or if some give
// a base that is not level and others give none. `logs` and `mountings` in the same order; `with_load`: which
// of the mountings' tools counts.
void refuse_unlike(std::span<const MeasuredLog> logs, std::span<const Mounting> mountings, bool with_load);

}  // namespace multipanda
