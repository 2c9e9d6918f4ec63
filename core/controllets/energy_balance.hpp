#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/controllets/energy_tank.hpp"

namespace multipanda {

// The parts of a torque whose work a passive law tracks separately.
enum TorquePart : std::size_t {
  kSpringPart,        // s J^T K_c x~
  kDampingPart,       // -J^T D_c V, without the set-point's velocity
  kFeedforwardPart,   // s J^T (D_c V_d + n D_z v_d,n + Lambda A_d)
  kNullSpacePart,     // springs and dampers of the null space
  kCoriolisPart,      // C dq
  kForcePart,         // J^T F_f'
  kForceDampingPart,  // -J^T n D_z v_n
  kTorqueParts
};

// Work of every part of the torque over the last period. The torque is constant over a period, so
// tau_part^T (q_now - q_before) is the exact work, not an estimate. (If the plant lags behind the command, it
// is the work of the command.) Loop thread, no allocation.
class EnergyBalance {
 public:
  void start(const JointVector& q);
  // Closes the period that ends at q. `tau_in_use` is the commanded torque, features and limits
  // included; its difference from the sum of the parts counts as work of others.
  void close(const JointVector& q, const JointVector& tau_in_use);
  // Opens the next period.
  void open(TorquePart part, const JointVector& tau) { tau_[part] = tau; }
  JointVector sum() const;

  double work(TorquePart part) const { return work_[part]; }  // [J]
  double work_of_others() const { return others_; }           // [J]

 private:
  std::array<JointVector, kTorqueParts> tau_;
  std::array<double, kTorqueParts> work_{};
  double others_ = 0;
  JointVector q_;
};

// Energy balance of a unified force-impedance law with two tanks, over all of its arms. With S = kinetic
// energy + springs + tanks, every period has S_next <= S + work of the contacts. Loop thread; allocates in
// the constructor only.
class TankBalance {
 public:
  explicit TankBalance(std::size_t arms) : arms_(arms) {}

  void start(std::span<const OwnedArm> arms, double tank_start_j, const TankLimits& limits);
  // Closes the last period. `stored_j` is the energy that the springs gained in it. The impedance tank
  // supplies the work of the impedance part, features and limits; the force tank that of the force part.
  void close(std::span<const OwnedArm> arms, double stored_j, ValveLaw law, const TankLimits& limits);

  EnergyBalance& arm(std::size_t i) { return arms_[i]; }
  double work(TorquePart part) const;                            // of all arms [J]
  double work_of_others() const;                                 // [J]
  double created() const { return created_; }                    // by make_up(), so far [J]
  void show_powers(std::span<double> outputs, double dt) const;  // of each TorquePart [W]

  EnergyTank force, impedance;

 private:
  std::vector<EnergyBalance> arms_;
  double created_ = 0;
};

}  // namespace multipanda
