#pragma once

#include <functional>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "scene/scene.hpp"

// A scene run in lock-step and judged by the plant's own truth.
namespace multipanda::trial {

struct Sample {
  double t = 0;
  Vector3 F_true = Vector3::Zero(), F_est = Vector3::Zero();  // exerted by the arm, world axes [N]
  Vector3 p = Vector3::Zero(), v = Vector3::Zero();           // of E, from the plant's joints [m], [m/s]
  Vector3 p_d = Vector3::Zero(), F_d = Vector3::Zero();       // references of the law (p_d: zero if none)
  double kinetic = 0;                                         // 1/2 dq^T M dq of the plant's joints [J]
  double spring = 0;                                          // 1/2 x~^T K x~ at full stiffness [J]
  double environment = 0;  // what the contacts put into the arm since the start [J]
  double rate = 0;         // largest change of a joint's torque before the limiter [N m/s]
  std::vector<double> outputs;
};

struct Run {
  std::vector<Sample> samples;  // one per millisecond
  std::vector<OutputSpec> outputs;
  std::uint64_t interventions = 0;  // of the safety stage, limiter included
  bool kept = true;                 // the law still owned the arm at the end
  std::string fault;                // of the simulation
  std::string rules;                // of the safety stage that acted, in words

  std::size_t column(const std::string& output) const;  // throws std::invalid_argument
  double at(const Sample& s, std::size_t column) const { return s.outputs[column]; }
};

// Runs the scene's first controllet for `duration_s` (0: the scene's). `each` may meddle with the world
// before every step.
struct Options {
  double duration_s = 0;
  std::function<void(double t, MujocoBackend&, ControlCycle&)> each;
};
Run run(const Scene& scene, const Options& options = {});

// The scene of a task with one thing changed at a time. `task`: "task_3".
Scene task(const std::string& name);
void set(Scene& scene, const std::string& parameter, std::vector<double> values);  // of the first controllet
SceneObject& table(Scene& scene);
double task_start(const Scene& scene);  // [s], when the motion of the timeline begins

// Over samples with from <= t < to.
double rms(const Run& run, double from, double to, const std::function<double(const Sample&)>& value);
double largest(const Run& run, double from, double to, const std::function<double(const Sample&)>& value);
double first_contact(const Run& run);  // [s]; true force above 0.5 N; infinity: never

inline double pressing(const Sample& s) { return -s.F_true.z(); }  // on a surface below
inline double force_error(const Sample& s) { return s.F_true.z() - s.F_d.z(); }
inline double estimate_error(const Sample& s) { return s.F_est.z() - s.F_d.z(); }
inline double path_error(const Sample& s) { return (s.p - s.p_d).head<2>().norm(); }

}  // namespace multipanda::trial
