// Prints the figures of task 5 as tables:
//   grasp_figures [TABLE ...] [PARAMETER=NUMBER,NUMBER,...] [trace=FILE] [repeats=NUMBER]
// Tables: repeats, surfaces, paper, push, tanks, disturbed, gone (default: all).
// Each PARAMETER changes the law.
#include <cstdio>

#include "tests/interaction/grasp_trial.hpp"
#include "tests/interaction/trial_arguments.hpp"

using namespace multipanda;
using namespace multipanda::grasp;

namespace {

void head(const char* title) {
  std::printf("\n%s\n%-26s | %5s | %6s %6s %6s %6s %6s | %6s %6s %6s %7s | %5s %5s %4s\n", title, "", "touch",
              "rms N", "least", "most", "L-R", "est N", "slip", "tilt", "lift", "lift mm", "rate", "grasp",
              "hits");
}

void row(const std::string& what, const Run& result) {
  const Figures f = figures(result);
  std::printf(
      "%-26s | %5.2f | %6.3f %6.2f %6.2f %6.2f %6.3f | %6.2f %6.3f %6.2f %7.1f | %5.0f %5.0f %4llu %s%s\n",
      what.c_str(), f.grasp_s, f.rms, f.least, f.most, f.uneven, f.estimate_rms, 1000 * f.slip,
      f.tilt * 180 / M_PI, 1000 * f.lift_error, 1000 * f.lift, f.rate_task, f.rate_grasp,
      static_cast<unsigned long long>(f.interventions), f.held ? "" : "NOT HELD ", result.fault.c_str());
  std::fflush(stdout);
}

void write_trace(const std::string& file, const Run& result) {
  std::FILE* out = std::fopen(file.c_str(), "w");
  std::fprintf(out, "t push_1 push_2 est_1 est_2 x y z p_d_z rate kinetic environment");
  for (const auto& spec : result.outputs) {
    for (std::size_t i = 0; i < spec.size; ++i) std::fprintf(out, " %s_%zu", spec.name.c_str(), i);
  }
  for (const auto& s : result.samples) {
    std::fprintf(out, "\n%.3f %.6g %.6g %.6g %.6g %.8g %.8g %.8g %.8g %.6g %.8g %.8g", s.t, s.push[0],
                 s.push[1], s.push_est[0], s.push_est[1], s.X_WO.position.x(), s.X_WO.position.y(),
                 s.X_WO.position.z(), s.p_d.z(), s.rate, s.kinetic, s.environment);
    for (const double value : s.outputs) std::fprintf(out, " %.8g", value);
  }
  std::fclose(out);
}

}  // namespace

int main(int argc, char** argv) {
  const TrialArguments arguments = parse_arguments(argc, argv);
  const std::vector<PlantFidelity> plants{PlantFidelity::ideal(), PlantFidelity::realistic(),
                                          PlantFidelity::realistic_sensors()};
  const auto scene_on = [&](const PlantFidelity& plant) {
    Scene scene = task();
    scene.plant = plant;
    for (const auto& [name, values] : arguments.parameters) set(scene, name, values);
    return scene;
  };
  if (arguments.has("repeats")) {
    head("Repeats");
    for (const auto& plant : plants) {
      for (std::uint32_t seed = 1; seed <= arguments.repeats; ++seed) {
        Scene scene = scene_on(plant);
        vary(scene, seed);
        const Run result = run(scene);
        row(plant.name + " " + std::to_string(seed), result);
        if (!arguments.trace.empty())
          write_trace(arguments.trace + "." + plant.name + "." + std::to_string(seed), result);
      }
    }
  }
  if (arguments.has("surfaces")) {
    head("Contact");
    for (const auto& plant : plants) {
      for (const double stiffness : {1e3, 1e4, 1e5}) {
        Scene scene = scene_on(plant);
        interaction::object(scene, "box").contact->stiffness_n_per_m = stiffness;
        row(plant.name + " " + std::to_string(static_cast<int>(stiffness)) + " N/m", run(scene));
      }
    }
  }
  if (arguments.has("paper")) {
    head("The paper's gains: 100 100 50 10 10 10 per arm, nothing fed forward");
    for (const auto& plant : plants) {
      for (const bool its_force_gains : {false, true}) {
        Scene scene = scene_on(plant);
        paper_gains(scene, its_force_gains);
        row(plant.name + (its_force_gains ? " and its PID" : " our force loop"), run(scene));
      }
    }
  }
  if (arguments.has("stiction")) {
    head("Dry friction of 0.3 N m in every joint, unknown to the controller");
    PlantFidelity plant = plants[0];
    plant.stiction_nm = 0.3;
    row("stiction", run(scene_on(plant)));
  }
  if (arguments.has("pushed")) {
    std::printf("\nA force on the hanging box\n%-16s | %27s | %9s %9s | %8s %8s %9s\n", "N",
                "box moves by mm", "F/K mm", "mm", "left N", "right N", "mean off");
    const Scene scene = scene_on(plants[0]);
    for (const Vector3& f : {Vector3(0, 6, 0), Vector3(0, -6, 0), Vector3(6, 0, 0), Vector3(0, 0, -6)}) {
      const Pushed p = push_box(scene, f);
      Eigen::Index axis = 0;
      f.cwiseAbs().maxCoeff(&axis);
      double K = 0;
      for (const auto& value : scene.controllets[0].parameters) {
        if (value.name == "translational_stiffness_n_per_m") K = value.values[static_cast<std::size_t>(axis)];
      }
      std::printf("%4.0f %4.0f %4.0f   | %8.2f %8.2f %8.2f  | %9.2f %9.2f | %8.2f %8.2f %9.3f\n", f.x(),
                  f.y(), f.z(), 1000 * p.box.x(), 1000 * p.box.y(), 1000 * p.box.z(), 1000 * f[axis] / K,
                  1000 * p.box[axis], p.squeeze[0], p.squeeze[1], p.worst_mean);
    }
  }
  if (arguments.has("tanks")) {
    head("Tanks");
    for (const double tank : {0.2, 0.5, 2.0, 100.0}) {
      Scene scene = scene_on(plants[0]);
      set(scene, "tank_start_j", {tank});
      const Run result = run(scene);
      char name[32];
      std::snprintf(name, sizeof name, "%g J", tank);
      row(name, result);
      std::printf("%-26s   energy beyond start and environment: %.2e J; largest gain %.2e J\n", "",
                  energy_excess(result, 1e-3), energy_gain(result));
    }
  }
  if (arguments.has("disturbed")) {
    std::printf("\nDisturbed: energy beyond start and contacts, at 1e-3 W\n%-26s | %10s %10s %10s %10s %9s\n",
                "", "excess J", "gain J", "least T_i", "least T_f", "rate");
    for (const auto& plant : plants) {
      for (const double tank : {0.2, 0.5, 2.0, 100.0}) {
        Scene scene = scene_on(plant);
        set(scene, "tank_start_j", {tank});
        const Run result = disturbed(scene, 7);
        if (!arguments.trace.empty())
          write_trace(arguments.trace + ".disturbed." + plant.name + std::to_string(tank), result);
        double least_i = 1e9, least_f = 1e9, rate = 0;
        for (const auto& s : result.samples) {
          least_i = std::min(least_i, result.at(s, "impedance_tank_j"));
          least_f = std::min(least_f, result.at(s, "force_tank_j"));
          if (s.t > 0.3) rate = std::max(rate, s.rate);
        }
        char name[48];
        std::snprintf(name, sizeof name, "%s, %g J", plant.name.c_str(), tank);
        std::printf("%-26s | %10.2e %10.2e %10.4f %10.4f %9.0f %s\n", name, energy_excess(result, 1e-3),
                    energy_gain(result), least_i, least_f, rate, result.kept ? "" : "NOT KEPT");
      }
    }
  }
  if (arguments.has("gone")) {
    std::printf("\nThe box vanishes at 9 s\n%-26s | %9s %9s %9s %9s %9s %9s\n", "", "speed m/s", "closed mm",
                "excess J", "gain J", "rate", "hits");
    for (const bool paper_law : {false, true}) {
      for (const double tank : {0.2, 0.5, 2.0, 100.0}) {
        Scene scene = scene_on(plants[0]);
        set(scene, "tank_start_j", {tank});
        set(scene, "valve_law", {paper_law ? 1.0 : 0.0});
        const Loss loss = box_vanishes(scene, 9.0);
        char name[48];
        std::snprintf(name, sizeof name, "%s, %g J", paper_law ? "paper" : "passive", tank);
        std::printf("%-26s | %9.3f %9.1f %9.2e %9.2e %9.0f %9llu\n", name, loss.speed, 1000 * loss.closed,
                    loss.energy_excess, loss.energy_gain, loss.rate,
                    static_cast<unsigned long long>(loss.interventions));
      }
    }
  }
}
