#pragma once

#include "tests/interaction/trial.hpp"

// The energy balance of `ufic` over disturbed runs: the stored energy (kinetic energy, spring and tanks)
// against the energy that the true contact forces put into the arm.
namespace multipanda::trial {

enum class Disturbance {
  loss,   // the table vanishes under 30 N and comes back lower
  wall,   // the table goes up and down by 15 mm
  jumps,  // set-points of pose and force jump, in contact and out of it
  all     // everything at once
};
inline constexpr Disturbance kDisturbances[] = {Disturbance::loss, Disturbance::wall, Disturbance::jumps,
                                                Disturbance::all};
const char* name(Disturbance disturbance);

struct Passivity {
  double seconds = 0;
  double excess = 0;         // largest S(t) - S(0) - W(t) - allowance t [J]; passive: at most 0
  double gain = 0;           // the same from any instant to any later one [J]
  double least_tank = 0;     // lowest energy of either tank [J]
  double injected = 0;       // energy that the tanks of the paper's law created [J]
  double moved = 0;          // length of the tool's path [m]
  double contact_share = 0;  // fraction of the time in true contact
  double imbalance = 0;      // of the controllet's own stored_energy_j against the plant's: largest [J]
  bool kept = true;
};
inline constexpr double kAllowance = 1e-3;  // [J/s]

Passivity passivity(Disturbance disturbance, double tank_start_j, bool paper_valve, std::uint32_t seed,
                    const PlantFidelity& plant = {});

}  // namespace multipanda::trial
