#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/inertial_parameters.hpp"

// Parameters that explain the torque and belong to physically consistent bodies. The unknowns are theta of
// every moving link, friction amplitudes f, tilt (a, b) and gains 1 + k of the torque sensors. The cost is
//   sum_j w_j^2 mean_t e_j^2 + lambda sum_links d(P_i) + gain_weight |k|^2 + small terms on tilt and f
//     + sum_i hold_i (theta_i - prior_i)^2
//   e_j = (1 + k_j) ((Y + a Y_a + b Y_b) theta)_j + F_j f_j - tau_j
// with d the distance to the prior (Divergence) and f >= 0 where friction would otherwise add energy. Dahl
// elements longer than a third of a joint's travel, which never slide fully, are left out for that joint. The
// solver is damped Newton (Gauss-Newton where unknowns multiply each other). Amplitudes stay at their bound
// while the gradient pushes them there (Bertsekas, SIAM J. Control Optim. 1982, doi 10.1137/0320018). Weights
// are w_j^2 = 1 / (s_j s), with s_j the spread of the residuals and s its geometric mean, over a few passes.
namespace multipanda {

// Definition of a candidate model.
struct Family {
  std::string name;
  std::vector<std::size_t> parts;  // which of the equations' friction parts
  bool tilt = false, gains = false;
  bool eligible = true;  // false: only for comparison
};

struct FitProblem {
  std::vector<FrictionPart> parts;  // of the equations
  Eigen::VectorXd prior;            // theta of every moving link, each inside the cone (10 n)
  std::vector<bool> fixed;          // per link: held at the prior
  Eigen::VectorXd hold;             // of every theta: weight of its squared distance to the prior; empty: 0
  Theta known = Theta::Zero();      // added to the last link: hand, tool
  Eigen::VectorXd travel;           // of every joint in the data (n) [rad]; empty: not known
  double lambda = 1e-2;
  double gain_weight = 1;
  int passes = 4;
};

struct Fit {
  Eigen::VectorXd theta;     // (10 n)
  Eigen::MatrixXd friction;  // amplitudes as seen by the sensor, zero for parts outside the family (n x
                             // parts)
  Eigen::Vector2d tilt = Eigen::Vector2d::Zero();  // [rad]
  Eigen::VectorXd gain;                            // k (n)
  Eigen::VectorXd spread;                          // root mean square of the residual (n) [N m]
  int iterations = 0;
};

// `start`: a fit of similar data whose weights and values are reused; none: the prior.
Fit fit_consistent(const Equations& equations, const FitProblem& problem, const Family& family,
                   const Fit* start = nullptr);

// Sum of e_j^2 over the rows of `equations`, per joint (n) [(N m)^2].
Eigen::VectorXd squared_errors(const Equations& equations, const FitProblem& problem, const Fit& fit);

}  // namespace multipanda
