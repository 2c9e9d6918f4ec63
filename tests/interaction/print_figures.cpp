// Prints the figures of force control as tables:
//   interaction_figures [task_3|task_4|stiction|paper|loss|passivity ...] [PARAMETER=NUMBER,NUMBER,...]
// Without a table it prints all of them. Each PARAMETER changes the law.
#include <cstdio>

#include "tests/interaction/figures.hpp"
#include "tests/interaction/trial_arguments.hpp"

using namespace multipanda;
using namespace multipanda::trial;

namespace {

void apply(const TrialArguments& arguments, Scene& scene) {
  for (const auto& [name, values] : arguments.parameters) set(scene, name, values);
}

void row(const std::string& what, const Surface& surface, const TaskFigures& f) {
  std::printf("%-10s %6.0f %5.2f %4.1f | %6.3f %6.2f %6.3f | %6.2f %6.2f | %6.2f | %6.0f %6.0f %4llu %s\n",
              what.c_str(), surface.stiffness, surface.damping_ratio, surface.friction, f.force_rms,
              f.force_max, f.estimate_rms, 1000 * f.path_rms, 1000 * f.path_max, f.peak, f.rate_task,
              f.rate_contact, static_cast<unsigned long long>(f.interventions), f.good ? "" : "NOT GOOD");
  std::fflush(stdout);
}
void head(const char* title) {
  std::printf("\n%s\n%-10s %6s %5s %4s | %6s %6s %6s | %6s %6s | %6s | %6s %6s %4s\n", title, "plant", "N/m",
              "zeta", "mu", "rms N", "max N", "est N", "path", "max mm", "peak N", "rate", "touch", "hits");
}

}  // namespace

int main(int argc, char** argv) {
  const TrialArguments arguments = parse_arguments(argc, argv);
  const auto change = [&](Scene& scene) { apply(arguments, scene); };
  PlantFidelity stiction = PlantFidelity::ideal();
  stiction.name = "stiction";
  stiction.stiction_nm = 0.3;
  const std::vector<PlantFidelity> plants{PlantFidelity::ideal(), PlantFidelity::realistic(),
                                          PlantFidelity::realistic_sensors()};
  if (arguments.has("task_3")) {
    head("Task 3: 0-30-0 N in 10 s");
    for (const auto& plant : plants) {
      for (const double zeta : {0.3, 0.05}) {
        for (const double k : {1e3, 1e4, 1e5}) {
          const Surface surface{k, zeta, 0.3};
          row(plant.name, surface, task_figures("task_3", plant, surface, change));
        }
      }
    }
  }
  if (arguments.has("task_4")) {
    head("Task 4: 9.81 N on a circle of 10 cm");
    for (const auto& plant : plants) {
      for (const double mu : {0.1, 0.3, 0.5}) {
        for (const double k : {1e3, 1e4, 1e5}) {
          const Surface surface{k, 0.3, mu};
          row(plant.name, surface, task_figures("task_4", plant, surface, change));
        }
      }
      for (const double k : {1e3, 1e4, 1e5}) {
        const Surface surface{k, 0.05, 0.3};
        row(plant.name, surface, task_figures("task_4", plant, surface, change));
      }
    }
  }
  if (arguments.has("stiction")) {
    head("Stiction of 0.3 N m in every joint");
    for (const char* name : {"task_3", "task_4"}) {
      for (const double k : {1e3, 1e4, 1e5}) {
        const Surface surface{k, 0.3, 0.3};
        row(name, surface, task_figures(name, stiction, surface, change));
      }
    }
  }
  if (arguments.has("paper")) {
    head("Task 4 with the paper's preset");
    for (const auto& plant : plants) {
      for (const double mu : {0.1, 0.3, 0.5}) {
        for (const double k : {1e3, 1e4, 1e5}) {
          const Surface surface{k, 0.3, mu};
          row(plant.name, surface, task_figures("task_4", plant, surface, [&](Scene& scene) {
                paper_preset(scene);
                apply(arguments, scene);
              }));
        }
      }
    }
  }
  if (arguments.has("loss")) {
    std::printf("\nThe table vanishes\n%-8s %-8s %6s (%6s) | %8s %8s %5s\n", "task", "law", "N", "held N",
                "m/s", "mm", "hits");
    const auto line = [](const char* name, const char* law, double force, const LossFigures& f) {
      std::printf("%-8s %-8s %6.2f (%6.2f) | %8.3f %8.1f %5llu %s\n", name, law, force, f.pressed, f.speed,
                  1000 * f.drop, static_cast<unsigned long long>(f.interventions), f.good ? "" : "NOT GOOD");
      std::fflush(stdout);
    };
    for (const double force : {9.81, 30.0}) {
      for (const char* task : {"task_3", "task_4"}) {
        line(task, "sensors", force, loss_figures(task, force, [&](Scene& scene) {
               scene.plant = PlantFidelity::realistic_sensors();
               apply(arguments, scene);
             }));
      }
      line("task_4", "default", force, loss_figures("task_4", force, change));
      line("task_4", "paper", force, loss_figures("task_4", force, [&](Scene& scene) {
             paper_preset(scene);
             apply(arguments, scene);
           }));
      line("task_4", "valve", force, loss_figures("task_4", force, [&](Scene& scene) {
             set(scene, "valve_law", {1});  // the paper's valve alone
             apply(arguments, scene);
           }));
      line("task_3", "force", force, loss_figures("task_3", force, change));
    }
  }
  if (arguments.has("passivity")) {
    std::printf(
        "\nEnergy: largest excess over start + contacts + 1 mJ/s\n%-9s %-6s %6s | %9s %9s | %9s "
        "%9s | %6s %6s %9s\n",
        "law", "run", "J", "excess J", "gain J", "least J", "made up J", "path m", "touch", "imbal. J");
    struct Case {
      const char* law;
      bool paper_valve;
      PlantFidelity plant;
    };
    for (const Case& c :
         {Case{"passive", false, PlantFidelity::ideal()}, Case{"paper", true, PlantFidelity::ideal()},
          Case{"realistic", false, PlantFidelity::realistic()}}) {
      for (const Disturbance disturbance : kDisturbances) {
        for (const double start : {0.2, 0.5, 2.0, 100.0}) {
          const Passivity p = passivity(disturbance, start, c.paper_valve, 1, c.plant);
          std::printf("%-9s %-6s %6.1f | %9.5f %9.5f | %9.4f %9.4f | %6.2f %6.2f %9.2g %s\n", c.law,
                      name(disturbance), start, p.excess, p.gain, p.least_tank, p.injected, p.moved,
                      p.contact_share, p.imbalance, p.kept ? "" : "NOT KEPT");
          std::fflush(stdout);
        }
      }
    }
  }
  return 0;
}
