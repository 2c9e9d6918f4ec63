#pragma once

#include "tests/interaction/trial.hpp"

// The energy balance of `ufic` over hostile runs: what is stored (kinetic energy of the plant's joints,
// spring of the task, both tanks) against what the contacts, by the plant's own truth, put into the arm.
namespace multipanda::trial {

enum class Hostility {
  loss,   // the table vanishes under 30 N and comes back lower
  wall,   // the table goes up and down by 15 mm
  jumps,  // set-points of pose and force jump, in contact and out of it
  all     // everything at once
};
inline constexpr Hostility kHostilities[] = {Hostility::loss, Hostility::wall, Hostility::jumps,
                                             Hostility::all};
const char* name(Hostility hostility);

struct Passivity {
  double seconds = 0;
  double excess = 0;         // largest S(t) - S(0) - W(t) - allowance t [J]; passive: at most 0
  double gain = 0;           // the same from any instant to any later one [J]
  double least_tank = 0;     // lowest energy of either tank [J]
  double made_up = 0;        // what tanks of the paper's law gave without having it [J]
  double moved = 0;          // length of the tool's way [m]: something has to happen
  double contact_share = 0;  // of the time, by the truth
  double imbalance = 0;      // of the controllet's own stored_energy_j against the plant's: largest [J]
  bool kept = true;
};
inline constexpr double kAllowance = 1e-3;  // [J/s]

Passivity passivity(Hostility hostility, double tank_start_j, bool paper_valve, std::uint32_t seed,
                    const PlantFidelity& plant = {});

}  // namespace multipanda::trial
