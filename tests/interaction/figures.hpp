#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tests/interaction/closed_loop.hpp"

// Trials of one arm in contact with a surface.
namespace multipanda::trial {

using interaction::set;
using interaction::task;

struct Sample : interaction::PlantSample {
  Vector3 F_true = Vector3::Zero(), F_est = Vector3::Zero();  // exerted by the arm, world axes [N]
  Vector3 p = Vector3::Zero(), v = Vector3::Zero();           // of E, from the plant's joints [m], [m/s]
  Vector3 p_d = Vector3::Zero(), F_d = Vector3::Zero();       // references of the law (p_d: zero if none)
  double spring = 0;                                          // 1/2 x~^T K x~ at full stiffness [J]
};

struct Run : interaction::Outcome {
  std::vector<Sample> samples;  // one per millisecond
};

// Runs the scene's first controllet for `duration_s` (0: the scene's). `each` may change the world before
// each step.
struct Options {
  double duration_s = 0;
  interaction::BeforeStep each;
};
Run run(const Scene& scene, const Options& options = {});

double task_start(const Scene& scene);  // [s], start of the timeline's motion

// Over samples with from <= t < to.
double rms(const Run& run, double from, double to, const std::function<double(const Sample&)>& value);
double largest(const Run& run, double from, double to, const std::function<double(const Sample&)>& value);
double first_contact(const Run& run);  // [s], true force above 0.5 N; infinity if it never is

inline double pressing(const Sample& s) { return -s.F_true.z(); }  // on a surface below
inline double force_error(const Sample& s) { return s.F_true.z() - s.F_d.z(); }
inline double estimate_error(const Sample& s) { return s.F_est.z() - s.F_d.z(); }
inline double path_error(const Sample& s) { return (s.p - s.p_d).head<2>().norm(); }

// The figures of force control, each from one run and from the plant's true forces.

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

// The energy balance of `ufic` over disturbed runs: the stored energy (kinetic energy, spring and tanks)
// against the energy that the true contact forces put into the arm.

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
