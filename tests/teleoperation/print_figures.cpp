// Prints the figures of followers and teleoperation in docs/results/control.md.
#include <cmath>

#include <fmt/format.h>

#include "tests/teleoperation/pairs.hpp"
#include "tests/teleoperation/trial.hpp"

int main() {
  using namespace multipanda;
  using namespace multipanda::teleoperation;
  const PlantFidelity plants[] = {PlantFidelity::ideal(), PlantFidelity::realistic(),
                                  PlantFidelity::realistic_sensors()};
  fmt::print("followers\n");
  for (const auto& plant : plants) {
    const PairsOutcome found = run(Pairs{.laws = {"joint_follower", "pose_follower"}, .plant = plant});
    fmt::print("  {:9} joint_follower: {:6.4f} rad, hand {:5.2f} mm; pose_follower: hand {:5.2f} mm {}\n",
               plant.name, found.pairs[0].joint_error, 1e3 * found.pairs[0].hand_error,
               1e3 * found.pairs[1].hand_error, found.interventions);
  }
  fmt::print("free motion\n");
  for (const bool force : {false, true}) {
    for (const auto& plant : plants) {
      for (const double scale : {1.0, 0.5}) {
        const FreeMotion f = free_motion({.position_force = force, .plant = plant, .scale = scale});
        fmt::print("  {:d} {:9} scale {:3g}: error {:5.2f} mm, felt {:5.2f} N {}\n", force, plant.name, scale,
                   1e3 * f.largest_error, f.largest_felt, f.fault);
      }
    }
  }
  fmt::print("contact\n");
  for (const bool force : {false, true}) {
    for (const auto& plant : plants) {
      for (const double table : {1e3, 1e4, 1e5}) {
        const Contact c = contact({.position_force = force, .plant = plant, .table_n_per_m = table});
        fmt::print("  {:d} {:9} {:6g} N/m: pressed {:5.2f} N, error {:5.2f} %, peak {:5.1f} N {}\n", force,
                   plant.name, table, c.pressed, 100 * c.error, c.peak, c.fault);
      }
    }
  }
  fmt::print("bandwidth\n");
  for (const double hz : {0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0}) {
    const Response r = response(hz);
    fmt::print("  {:4g} Hz: position {:5.3f}, phase {:6.1f} deg\n", hz, r.gain, r.phase * 180 / M_PI);
  }
  fmt::print("passivity\n");
  for (const bool force : {false, true}) {
    for (const double tanks : {5.0, 0.05}) {
      for (const double delay : {0.0, 0.01, 0.05, 0.1, 0.2}) {
        for (const double loss : {0.0, 0.3}) {
          for (const double table : {1e3, 1e4, 1e5}) {
            const Outcome o = run(disturbed({.position_force = force,
                                             .table_n_per_m = table,
                                             .delay_s = delay,
                                             .loss = loss,
                                             .tank_start_j = tanks},
                                            1));
            const Passivity p = passivity(o);
            fmt::print(
                "  {:d} tanks {:4g} delay {:4g} loss {:3g} {:6g} N/m: excess {:9.2e} J, gain {:9.2e} J, tank "
                "{:6.3f} J, "
                "imbalance {:7.1e}, {:4.2f} m/s, contact {:4.2f} kept {:d} {} {}\n",
                force, tanks, delay, loss, table, p.excess, p.gain, p.least_tank, p.imbalance, p.speed,
                p.contact_share, o.kept, o.fault, o.rules);
          }
        }
      }
    }
  }
}
