// Every seeded approach as a line, for tuning and for the figures in docs/results/control.md.
#include <cstdio>
#include <cstdlib>

#include "tests/collision/approach.hpp"

// print_approaches [range_m stiffness_n_per_m damping_n_s_per_m]
int main(int argc, char** argv) {
  using namespace multipanda;
  using namespace multipanda::approach;
  double worst = 1e9;
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    Outcome without;
    Approach approach = draw_touching(seed, without);
    for (auto& law : approach.scene.controllets) {
      const char* names[] = {"range_m", "stiffness_n_per_m", "damping_n_s_per_m"};
      for (int i = 1; i < argc && i < 4; ++i) {
        law.parameters.push_back({std::string("collision_avoidance.") + names[i - 1], {std::atof(argv[i])}});
      }
    }
    const Outcome with = run(approach, true);
    std::printf(
        "%2u %-8s without: %6.1f mm %.2f m/s, rate cut %3lu %s| with: %s %5.1f mm %.2f m/s, torque %.2f, cut "
        "%lu, rate cut %lu %s\n",
        seed, to_string(approach.kind).c_str(), 1e3 * without.clearance, without.speed,
        static_cast<unsigned long>(without.rate_cut), without.taken_out.c_str(),
        with.touched ? "TOUCHED" : "", 1e3 * with.clearance, with.speed, with.torque_share,
        static_cast<unsigned long>(with.torque_cut), static_cast<unsigned long>(with.rate_cut),
        with.taken_out.c_str());
    worst = std::min(worst, with.clearance);
  }
  std::printf("smallest clearance %.1f mm\n", 1e3 * worst);
}
