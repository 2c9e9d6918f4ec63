#pragma once

#include "core/state/arm_state.hpp"
#include "core/state/force_sensor.hpp"

namespace multipanda {

// What can be done with an arm in this cycle. Computed once per arm and cycle, right after the states are
// read: the only source for whether an arm takes commands, whether it has just come back, how old its state
// is and which torque it has in use.
struct ArmCondition {
  bool usable = false;        // it takes torque commands, by its last state
  bool began = false;         // as of this state: it took none before
  bool returned = false;      // it began, or its states were interrupted for too long
  double age_s = 0;           // of its last state
  double gap_s = 0;           // fresh: between its last two states; otherwise, or if it is the first: 0
  JointVector torque_in_use;  // at its last state [N m] (n x 1)
  SensorFault sensor;         // why its force sensor, if it has one, is not to be believed

  // `dt`: since the last cycle. `longest_gap_s`: after a longer gap, the arm counts as one that returns.
  void update(const ArmState& state, double dt, double longest_gap_s) {
    const bool was_usable = usable;
    usable = takes_commands(state.mode);
    gap_s = state.fresh && seen_ ? age_s + dt : 0.0;
    age_s = state.fresh ? 0.0 : age_s + dt;
    seen_ = seen_ || state.fresh;
    began = usable && !was_usable;
    returned = began || (usable && gap_s > longest_gap_s);
    if (state.fresh) torque_in_use = state.tau_J_d;
  }

 private:
  bool seen_ = false;  // it has had a state
};

}  // namespace multipanda
