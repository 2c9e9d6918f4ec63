// Prints the figures of docs/results/control.md as Markdown.
#include <cstdio>

#include "backends/mujoco/testing/forces_rig.hpp"

namespace {

using namespace multipanda;
using namespace multipanda::test;

struct Row {
  const char* what;
  std::function<WrenchError(const PlantFidelity&)> measure;
};

std::function<WrenchError(const PlantFidelity&)> worst_arm(WrenchError (*measure)(const SceneArm&,
                                                                                  const PlantFidelity&)) {
  return [measure](const PlantFidelity& plant) {
    WrenchError worst;
    for (const auto& [name, arm] : measured_arms()) worst.take_worse(measure(arm, plant));
    return worst;
  };
}

void print_errors() {
  const Row rows[] = {
      {"push of 20 N, 3 N m at K, 12 directions", worst_arm(error_under_pushes)},
      {"payload 1.2 kg, declared", worst_arm([](const SceneArm& arm, const PlantFidelity& plant) {
         return error_with_payload(arm, true, plant);
       })},
      {"payload 1.2 kg, not declared", worst_arm([](const SceneArm& arm, const PlantFidelity& plant) {
         return error_with_payload(arm, false, plant);
       })},
      {"pressing on a surface, about 25 N", worst_arm(error_pressing)},
      {"two arms squeeze a box, 20 N", error_squeezing},
      {"free motion, all joints to 1 rad/s", worst_arm(error_in_motion)}};
  PlantFidelity smooth = PlantFidelity::realistic();
  smooth.joint_friction = false;
  std::printf(
      "| | `ideal`: max | `realistic`: bias | rms | max | its rms without friction "
      "|\n|---|---|---|---|---|---|\n");
  for (const Row& row : rows) {
    const WrenchError ideal = row.measure(PlantFidelity::ideal());
    const WrenchError real = row.measure(PlantFidelity::realistic()), bare = row.measure(smooth);
    std::printf(
        "| %s | %.3f N, %.4f N m | %.2f N, %.3f N m | %.2f N, %.3f N m | %.1f N, %.2f N m | %.2f N, %.3f N m "
        "|\n",
        row.what, ideal.force.max, ideal.torque.max, real.force.bias, real.torque.bias, real.force.rms,
        real.torque.rms, real.force.max, real.torque.max, bare.force.rms, bare.torque.rms);
    std::fflush(stdout);
  }
}

void print_motion() {
  std::printf("\n| free motion, `ideal` | max |\n|---|---|\n");
  for (const auto& [name, arm] : measured_arms()) {
    const WrenchError error = error_in_motion(arm, PlantFidelity::ideal());
    std::printf("| %s | %.3f N, %.4f N m |\n", name.c_str(), error.force.max, error.torque.max);
  }
}

void print_response() {
  std::printf("\n| sine [Hz] | gain | lag [ms] |\n|---|---|---|\n");
  for (const double f : {1.0, 2.0, 5.0, 10.0, 20.0, 27.56, 60.0}) {
    const Response response = response_to_sine(f, PlantFidelity::ideal());
    std::printf("| %g | %.3f | %.2f |\n", f, response.gain, 1000 * response.lag_s);
  }
  const StepResponse step = response_to_step(PlantFidelity::ideal());
  std::printf("\nStep of 10 N: 63 %% after %.1f ms, 99 %% after %.1f ms, overshoot %.2f %%.\n",
              1000 * step.to_63_s, 1000 * step.to_99_s, 100 * step.overshoot);
}

}  // namespace

int main() {
  print_errors();
  print_motion();
  print_response();
  return 0;
}
