#pragma once

#include <cstdint>
#include <string>

// A goal on the far side of a person's hand: how hard is it pressed? The hand is the model of ISO/TS 15066
// (table A.3, hands and fingers): 0.6 kg on a spring of 75 N/mm; clamped, because the spring ends at a table.
namespace multipanda::press {

struct Press {
  std::string controllet;
  int pose = 0;  // of the arm, 0 to 3
  bool motor_inertia = false;
  bool bounded = true;          // with the bounds for contact
  double released_after_s = 0;  // since it was touched, the person's hand is gone; 0: never
  double stiffness = 0;         // of cartesian_impedance [N/m]; 0: its usual one
  bool axes = false;            // of ufic: a force along z, no moments about x and y
  double beyond = 0.3;          // way from the person's hand to the goal [m]
};

inline constexpr int kPoses = 4;
// ISO/TS 15066, table A.2, back and palm of the hand: 140 N clamped (quasi-static), twice that in the first
// 0.5 s (transient).
inline constexpr double kTransient = 280, kQuasiStatic = 140, kTransientTime = 0.5;  // [N], [s]

struct Outcome {
  double impact = 0, later = 0;  // largest force of the spring until and after kTransientTime [N]
  double swing = 0;              // of the force in the last second [N]
  double at_end = 0;             // [N]
  double hand_speed = 0;         // largest speed of the robot's hand before it touched [m/s]
  double let_go_speed = 0;       // the same after the person's hand is gone [m/s]
  bool touched = false;
  std::string intervention;  // the first one, if any
};

Outcome run(const Press& press);
std::string name(const Press& press);

}  // namespace multipanda::press
