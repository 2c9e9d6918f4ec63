#pragma once

#include <cstdint>

#include "core/types/joints.hpp"

namespace multipanda {

// The work of an arm's commanded torque, booked twice: by the arm, period by period, and by the program from
// the states that it received. What a lost state hides is booked as unseen.
class WorkBook {
 public:
  // The arm: after each period, where it is and the torque that acts from now on (nullptr: its own).
  void arm_period(const JointVector& q, const JointVector* tau);
  // The program: a fresh state; `seen`: the one before it was of the period before. `counts`: the arm was in
  // torque control in both.
  void state(const JointVector& q, const JointVector& tau_in_use, bool seen, bool counts);

  double of_arm() const { return arm_; }          // [J]
  double of_program() const { return program_; }  // [J]
  double unseen() const { return unseen_; }       // booked where a state is missing, as a size [J]
  double difference() const { return program_ - arm_; }

 private:
  double arm_ = 0, program_ = 0, unseen_ = 0;
  JointVector q_arm_, tau_arm_, q_program_, tau_program_;
  bool arm_commanded_ = false;
};

}  // namespace multipanda
