#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "scene/scene.hpp"

// Task 5, two arms that grasp a box, run in lock-step and judged by the plant's own truth.
namespace multipanda::grasp {

struct Sample {
  double t = 0;
  std::array<double, 2> push{}, push_est{};  // of each hand on the box, inwards [N]: truth, estimate
  std::array<Pose, 2> X_WE;                  // from the plant's joints
  Pose X_WO;                                 // of the box
  Vector3 p_d = Vector3::Zero();             // set-point of A
  double wanted = 0;                         // squeeze asked for [N]
  double kinetic = 0;                        // of both arms [J]
  double environment = 0;                    // what contacts put into both arms since the start [J]
  double rate = 0;                           // largest change of a joint's torque before the limiter [N m/s]
  std::vector<double> outputs;               // of the law
};

struct Run {
  std::vector<Sample> samples;  // one per millisecond
  std::vector<OutputSpec> outputs;
  std::uint64_t interventions = 0;  // of the safety stage on both arms, limiter included
  bool kept = true;                 // the law still owned the arms at the end
  std::string fault;                // of the simulation

  std::size_t column(const std::string& output) const;  // throws std::invalid_argument
  double at(const Sample& s, const std::string& output) const { return s.outputs[column(output)]; }
};

// Runs the scene's first controllet. `each` may meddle with the world before every step.
using Meddle = std::function<void(double t, MujocoBackend&)>;
Run run(const Scene& scene, const Meddle& each = {});

Scene task();  // experiments/scenes/task_5.yaml
void set(Scene& scene, const std::string& parameter, std::vector<double> values);
SceneObject& box(Scene& scene);
// The box of a real table: some millimetres, a degree and some grams from where it should be.
void vary(Scene& scene, std::uint32_t seed);

struct Figures {
  double grasp_s = 0;                    // when both hands touch
  double rms = 0;                        // of the worse hand's force over the task [N]
  double least = 0, most = 0;            // force of both hands over the task [N]
  double estimate_rms = 0;               // of the raw estimate of the mean, reported apart [N]
  double uneven = 0;                     // largest difference between the hands [N]
  double slip = 0;                       // of the worse hand [m]
  double tilt = 0;                       // of the box [rad]
  double lift_error = 0;                 // of the box against the set-point [m]
  double lift = 0;                       // how high the box came [m]
  double rate_task = 0, rate_grasp = 0;  // before the limiter, in the task and before it [N m/s]
  std::uint64_t interventions = 0;
  bool held = false;  // squeezed by both hands through the whole task, law in charge
};
// The task: 10 s that begin 3 s after the grasp.
Figures figures(const Run& run);

// Energy of arms, springs and tanks beyond what it was at the start and what the contacts put in [J]: largest
// over the run, less `allowed_w` times the time.
double energy_excess(const Run& run, double allowed_w);
// The same between any two instants, so that what was dissipated before excuses nothing [J].
double energy_gain(const Run& run);

// The paper's stiffness, nothing fed forward, no integral; with its PID on the force, divided by 200 N/m, or
// with the scene's.
void paper_gains(Scene& scene, bool its_force_gains);

struct Loss {
  double speed = 0;          // largest of a hand after the box is gone [m/s]
  double closed = 0;         // that the hands came nearer to each other [m]
  double energy_excess = 0;  // at 1e-3 W [J]
  double energy_gain = 0;    // [J]
  double rate = 0;           // before the limiter, afterwards [N m/s]
  double squeezed = 0;       // mean force right before [N]
  std::uint64_t interventions = 0;
  bool kept = true;
};
// Grasped, then ill-treated for five seconds: the set-point jumps about, somebody pulls at the box.
Run ill_treated(Scene scene, std::uint32_t seed);

// A steady force on the box, which hangs between the hands.
struct Pushed {
  Vector3 box = Vector3::Zero();    // how far it went [m]
  std::array<Vector3, 2> hand;      // and each hand [m]
  std::array<double, 2> squeeze{};  // of each hand under the force [N]
  double worst_mean = 0;            // largest error of the mean squeeze, from the push on [N]
  bool kept = false;
};
Pushed push_box(Scene scene, const Vector3& force);

Loss box_vanishes(Scene scene, double at_s);

}  // namespace multipanda::grasp
