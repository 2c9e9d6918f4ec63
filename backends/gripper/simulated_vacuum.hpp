#pragma once

#include <string>

#include "backends/gripper/motion_results.hpp"
#include "core/cycle/backend.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

struct VacuumLimits {
  double vacuum_mbar = 800;    // below ambient pressure, most
  double cup_diameter = 0.04;  // [m]
  double reach = 0.005;        // from the cup to a part that it can still seal [m]
  double friction = 0.5;       // between part and cup
};

// Behaviour of a vacuum gripper with one suction cup: pump, vacuum, when a part holds and when it tears off.
// No wire, no clock, no physics: whoever owns the world calls step() once per control period, says whether a
// part is in reach and how hard the held one pulls, and holds it or not as step() says.
//
// The cup holds with F = area x vacuum. A held part tears off where pull + shear / friction + moment / radius
// exceeds F for 5 ms. docs/gripper.md has the figures.
class SimulatedVacuum {
 public:
  using Ticket = MotionResults::Ticket;

  struct State {
    bool in_control_range = false;  // the vacuum asked for is there
    bool part_detached = false;     // a part was let go or torn off since the last suction began
    bool part_present = false;      // the cup holds a part
    int power_percent = 0;          // of the pump
    double vacuum_mbar = 0;         // below ambient pressure
  };

  explicit SimulatedVacuum(const VacuumLimits& limits = {}) : limits_(limits) {}

  static std::string check(const VacuumOn& request);
  static std::string check(const VacuumDrop& request);

  // Requests that passed check(). Vacuum above what the pump can is limited.
  Ticket start(const VacuumOn& request);    // success: a part is held and the vacuum is there in time
  Ticket start(const VacuumDrop& request);  // success: no part is held any more
  void stop();  // pump and blow-off end; a held part stays until the vacuum has leaked away
  GripperResult result(Ticket ticket) const { return results_.of(ticket); }

  // One control period of `dt`. `in_reach`: a part is near enough to be sealed, or held. F_E: what the held
  // part's hold exerts on it, about the cup, axes of E (z out of the cup; below 0: the cup pulls) [N, N m].
  // Returns whether the part is held in this period.
  bool step(bool in_reach, const Wrench& F_E, double dt);

  bool holds() const { return holds_; }
  const State& state() const { return state_; }
  GripperState gripper_state() const;
  const VacuumLimits& limits() const { return limits_; }
  double holding_force() const;  // at the present vacuum [N]

  void reset();

 private:
  enum class Pump : std::uint8_t { off, suction, blow_off };
  bool overloaded(const Wrench& F_E, double dt);

  VacuumLimits limits_;
  MotionResults results_;
  State state_;
  Pump pump_ = Pump::off;
  bool holds_ = false;
  double wanted_mbar_ = 0;
  double time_left_s_ = 0;  // of the running motion
  double overload_s_ = 0;   // for how long the load was too much
};

}  // namespace multipanda
