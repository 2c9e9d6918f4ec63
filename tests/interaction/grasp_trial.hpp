#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "tests/interaction/closed_loop.hpp"

// Trials of task 5: two arms that grasp a box.
namespace multipanda::grasp {

using interaction::set;

struct Sample : interaction::PlantSample {
  std::array<double, 2> push{}, push_est{};  // force of each hand on the box, inwards [N]: truth, estimate
  std::array<Pose, 2> X_WE;                  // from the plant's joints
  Pose X_WO;                                 // of the box
  Vector3 p_d = Vector3::Zero();             // set-point of A
  double squeeze_d = 0;                      // desired squeeze [N]
};

struct Run : interaction::Outcome {
  std::vector<Sample> samples;  // one per millisecond

  double at(const Sample& s, const std::string& output) const { return s.outputs[column(output)]; }
};

// Runs the scene's first controllet. `each` may change the world before each step.
using Disturbance = std::function<void(double t, MujocoBackend&)>;
Run run(const Scene& scene, const Disturbance& each = {});

Scene task();  // experiments/scenes/task_5.yaml
// Moves, turns and loads the box by some millimeters, a degree and some grams, as on a real table.
void vary(Scene& scene, std::uint32_t seed);

struct Figures {
  double grasp_s = 0;                    // when both hands are in contact
  double rms = 0;                        // of the worse hand's force over the task [N]
  double least = 0, most = 0;            // force of both hands over the task [N]
  double estimate_rms = 0;               // of the raw estimate of the mean [N]
  double uneven = 0;                     // largest difference between the hands [N]
  double slip = 0;                       // of the worse hand [m]
  double tilt = 0;                       // of the box [rad]
  double lift_error = 0;                 // of the box against the set-point [m]
  double lift = 0;                       // largest height of the box [m]
  double rate_task = 0, rate_grasp = 0;  // before the limiter, in the task and before it [N m/s]
  std::uint64_t interventions = 0;
  bool held = false;  // both hands squeezed it through the whole task and the law kept the arms
};
// The task: 10 s that begin 3 s after the grasp.
Figures figures(const Run& run);

// Energy of arms, springs and tanks beyond that of the start and that from the contacts [J]: the largest of
// the run, minus `allowed_w` times the time.
double energy_excess(const Run& run, double allowed_w);
// The same between any two instants, so that earlier dissipation does not hide a gain [J].
double energy_gain(const Run& run);

// Sets the paper's stiffness, without feedforward and integral; with the paper's PID on the force, divided by
// 200 N/m, or with the scene's.
void paper_gains(Scene& scene, bool its_force_gains);

struct Loss {
  double speed = 0;          // largest of a hand after the box is gone [m/s]
  double closed = 0;         // how much nearer the hands came to each other [m]
  double energy_excess = 0;  // at 1e-3 W [J]
  double energy_gain = 0;    // [J]
  double rate = 0;           // before the limiter, afterwards [N m/s]
  double squeezed = 0;       // mean force just before [N]
  std::uint64_t interventions = 0;
  bool kept = true;
};
// Disturbs the grasp for five seconds: the set-point jumps, and forces pull at the box.
Run disturbed(Scene scene, std::uint32_t seed);

// Displacements under a steady force on the box, which hangs between the hands.
struct Pushed {
  Vector3 box = Vector3::Zero();    // displacement [m]
  std::array<Vector3, 2> hand;      // displacements [m]
  std::array<double, 2> squeeze{};  // of each hand under the force [N]
  double worst_mean = 0;            // largest error of the mean squeeze after the push [N]
  bool kept = false;
};
Pushed push_box(Scene scene, const Vector3& force);

Loss box_vanishes(Scene scene, double at_s);

}  // namespace multipanda::grasp
