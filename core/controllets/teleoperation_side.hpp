#pragma once

#include "core/controllets/energy_balance.hpp"
#include "core/controllets/energy_tank.hpp"

// Parts of `teleoperation` that both of its arms have. Loop thread, no allocation.
namespace multipanda::teleoperation {

// One arm's energy: the tank supplies all work of the arm's torque, features and limits included.
struct Side {
  EnergyTank tank;
  EnergyBalance balance;
  double valve = 0;  // of the pull

  void start(const OwnedArm& arm, double energy_j, const TankLimits& limits);
  // Closes the last period: the torque was constant in it, so this work is exact.
  void close(const OwnedArm& arm, const TankLimits& limits, double dt);
  // What the tank lets through of a pull (6 x 1) [N, N m]: where it supplies power its valve's share, where
  // it takes power all of it; and at most a tenth of the tank per tick. `V` (6 x 1) [m/s, rad/s] is the
  // hand's twist, `D` [N s/m, N m s/rad] the damping of the law.
  Vector6 let_through(const Vector6& pull, const Vector6& V, const Matrix6& D, const TankLimits& limits,
                      double dt) const;
};

// The share of a pull that the joints bear on top of the rest of the torque, with gravity and without: the
// first is what a joint measures, which stops its arm beyond its limit, the second is the command, which has
// the same limit. With 60 N and 15 N m a wrist of 12 N m soon gets there.
double bearable_share(const OwnedArm& arm, const JointVector& pull, const JointVector& rest);

}  // namespace multipanda::teleoperation
