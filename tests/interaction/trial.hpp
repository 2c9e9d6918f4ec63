#pragma once

#include <functional>
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

}  // namespace multipanda::trial
