#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/spec_table.hpp"

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

  double work(TorquePart part) const { return work_[part]; }  // work of a part [J]
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
  double work(TorquePart part) const;  // of all arms [J]
  double work_of_others() const;       // [J]

  // Writes the kTankOutputCount numbers. `scale` and `energy` [J] of the springs, `supplied` [J]: the work
  // that the impedance tank gave them in this tick.
  struct Shown {
    double gamma, alpha_f, scale, energy, supplied;
  };
  void show(std::span<double> outputs, std::span<const OwnedArm> arms, const Shown& now, double dt) const;

  EnergyTank force, impedance;

 private:
  std::vector<EnergyBalance> arms_;
  double created_ = 0;  // total from make_up() [J]
};

// --- descriptor parts shared by laws with two tanks ---
enum TankParameter : std::size_t {
  kValveLaw,
  kReach,
  kTankStart,
  kTankMin,
  kTankMax,
  kTankClosing,
  kTankParameterCount
};
SpecsAt<ParameterSpec, 0, kTankParameterCount> tank_parameters();

// Their values; `first` is the index of the group's first parameter in the controllet's descriptor.
struct TankSettings {
  ValveLaw law = ValveLaw::passive;
  double reach = 0;    // d_max [m]
  double start_j = 0;  // [J]
  TankLimits limits;
};
TankSettings tank_settings(const ParameterSet& parameters, std::size_t first);

enum TankOutput : std::size_t {
  kGamma,
  kAlphaForce,
  kAlphaImpedance,
  kForceTank,
  kImpedanceTank,
  kStored,
  kKinetic,
  kSpringPower,
  kSetPointPower = kSpringPower + kTorqueParts,
  kOtherPower,
  kCreated,
  kTankOutputCount
};
SpecsAt<OutputSpec, 0, kTankOutputCount> tank_outputs();

}  // namespace multipanda
