#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tests/interaction/closed_loop.hpp"
#include "tests/teleoperation/operator.hpp"

// Trials of `teleoperation`: an operator leads one arm, and the other meets a table or moves freely. Both
// bases are turned and off the origin.
namespace multipanda::teleoperation {

struct Sample : interaction::PlantSample {  // its environment: contacts and the operator
  Vector3 felt = Vector3::Zero();           // coupling force on the leader's hand, world axes [N]
  Vector3 contact = Vector3::Zero();        // true force of the follower on the table [N]
  Vector3 led = Vector3::Zero();            // to where the leader's true hand leads, from the start [m]
  Vector3 error = Vector3::Zero();          // of the follower's true hand to where the leader's leads [m]
  double speed = 0;                         // of the faster hand [m/s]
};

struct Trial {
  bool position_force = false;
  PlantFidelity plant = PlantFidelity::ideal();
  double table_n_per_m = 0;  // 0: there is none
  double delay_s = 0, loss = 0;
  double scale = 1, force_scale = 1;
  double tank_start_j = 5, refill_below_j = 1;
  double undeclared_kg = 0;  // at the follower's flange
  double duration_s = 6;
  // Where the operator leads, as way from the start in the follower's axes; nothing: he lets go.
  std::function<Vector3(double t)> way;
  std::function<bool(double t)> holds = [](double) { return true; };
};

struct Outcome : interaction::Outcome {
  std::vector<Sample> samples;  // one per millisecond
  double of(const Sample& s, const std::string& output) const { return s.outputs[column(output)]; }
};

inline constexpr double kGap = 0.01;  // from the follower's tool to the table at the start [m]

Outcome run(const Trial& trial);
std::string name(const Trial& trial);

struct Passivity {
  double excess = 0;       // largest S(t) - S(0) - W(t) - 1 mJ/s t [J]; passive: at most 0
  double least_valve = 1;  // of the follower
  double gain = 0;         // the same from any instant to any later one [J]
  double least_tank = 0;   // lowest energy of either tank [J]
  double imbalance = 0;    // of the law's own stored_energy_j against the plant's: largest [J]
  double speed = 0;        // of the hands: largest [m/s]
  double contact_share = 0;
};
Passivity passivity(const Outcome& outcome);

// Figures of teleoperation: errors of position and force, bandwidth, energy.

struct FreeMotion {
  double largest_error = 0;  // between both hands [m]
  double largest_felt = 0;   // force on the leader [N]
  std::string fault;         // of the run; empty: none
};
FreeMotion free_motion(Trial trial);  // up to 0.2 m/s and 0.4 m/s^2, along all axes

struct Contact {
  double pressed = 0;  // true force at rest [N]
  double error = 0;    // largest difference to the force felt, as share of the true one, above 5 N
  double peak = 0;     // [N]
  std::string fault;
};
Contact contact(Trial trial);  // pressed within 1 s, kept, and pressed harder

struct Response {
  double gain = 0, phase = 0;  // follower's hand to leader's, free motion; [rad]
};
Response response(double frequency_hz);

// An operator who leads to and fro on the table, off it, jumps, and lets go at times.
Trial disturbed(Trial trial, std::uint32_t seed);

}  // namespace multipanda::teleoperation
