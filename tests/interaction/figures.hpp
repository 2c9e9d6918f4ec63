#pragma once

#include <string>

#include "tests/interaction/trial.hpp"

// The figures of force control, each from one run and from the plant's true forces.
namespace multipanda::trial {

struct Surface {
  double stiffness = 10000;  // [N/m]
  double damping_ratio = 0.3;
  double friction = 0.3;
};
using Change = std::function<void(Scene&)>;

struct TaskFigures {
  double contact_s = 0;               // first contact
  double force_rms = 0;               // over the task's 10 s [N]
  double force_max = 0;               // [N]
  double estimate_rms = 0;            // of the raw estimate [N]
  double path_rms = 0, path_max = 0;  // against the moving set-point, across the force [m]
  double peak = 0;                    // largest force within 0.3 s of the first contact [N]
  double rate_task = 0;               // torque rate before the limiter, in the task [N m/s]
  double rate_contact = 0;            // the same within 0.5 s of the first contact
  std::uint64_t interventions = 0;
  bool good = false;  // contact 1.5 s before the task, the law kept the arm without a fault
};
// `task`: "task_3" or "task_4".
TaskFigures task_figures(const std::string& task, const PlantFidelity& plant, const Surface& surface,
                         const Change& change = {});

struct LossFigures {
  double speed = 0;    // largest, after the table is gone [m/s]
  double pressed = 0;  // true force just before [N]
  double drop = 0;     // largest drop of E [m]
  std::uint64_t interventions = 0;
  bool good = false;
};
// The table vanishes under a force held for two seconds.
LossFigures loss_figures(const std::string& task, double force, const Change& change = {});

// Sets the parameters of `ufic` to the paper's figures.
void paper_preset(Scene& scene);

}  // namespace multipanda::trial
