#pragma once

#include <string>

#include "backends/gripper/simulated_gripper.hpp"
#include "core/cycle/backend.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

struct VacuumLimits {
  double vacuum_mbar = 800;    // largest vacuum below ambient pressure
  double cup_diameter = 0.04;  // [m]
  double reach = 0.005;        // from the cup to a part that it can still seal [m]
  double friction = 0.5;       // between part and cup
};

// Behavior of a vacuum gripper with one suction cup: pump, vacuum, holding and detaching of a part. The owner
// of the world calls step() once per control period with the load on the held part, and holds the part if
// step() returns true.
//
// The cup holds with F = area x vacuum. A held part detaches if pull + shear / friction + moment / radius
// exceeds F for 5 ms. docs/gripper.md lists the values.
class SimulatedVacuum {
 public:
  using Ticket = MotionResults::Ticket;

  struct State {
    bool in_control_range = false;  // the requested vacuum is reached
    bool part_detached = false;     // a part was released or detached since the last suction started
    bool part_present = false;      // the cup holds a part
    int power_percent = 0;          // of the pump
    double vacuum_mbar = 0;         // below ambient pressure
  };

  explicit SimulatedVacuum(const VacuumLimits& limits = {}) : limits_(limits) {}

  // Requests that passed check(). The vacuum is limited to the pump's range.
  Ticket start(const VacuumOn& request);    // success: a part is held and the vacuum is reached in time
  Ticket start(const VacuumDrop& request);  // success: the part is released
  void stop();  // ends pump and blow-off; a held part stays until the vacuum has leaked
  GripperResult result(Ticket ticket) const { return results_.of(ticket); }

  // One control period of `dt`. `in_reach`: a part is near enough to be sealed, or held. F_E: wrench of the
  // suction constraint on the held part, about the cup, axes of E (z out of the cup; below 0: the cup pulls)
  // [N, N m]. Returns whether the part is held in this period.
  bool step(bool in_reach, const Wrench& F_E, double dt);

  bool holds() const { return holds_; }
  const State& state() const { return state_; }
  GripperState gripper_state() const;
  const VacuumLimits& limits() const { return limits_; }
  double holding_force() const;  // at the current vacuum [N]

  void reset();

 private:
  enum class Pump : std::uint8_t { off, suction, blow_off };
  bool overloaded(const Wrench& F_E, double dt);

  VacuumLimits limits_;
  MotionResults results_;
  State state_;
  Pump pump_ = Pump::off;
  bool holds_ = false;
  double requested_mbar_ = 0;
  double time_left_s_ = 0;  // of the running motion
  double overload_s_ = 0;   // duration of the current overload
};

}  // namespace multipanda
