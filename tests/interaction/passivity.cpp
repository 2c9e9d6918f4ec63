#include "tests/interaction/passivity.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace multipanda::trial {
namespace {

constexpr double kDuration = 8, kBegin = 2.5;  // [s]; the tool comes into contact before kBegin

// Disturbs the table and the set-points, by the seed.
class Disturber {
 public:
  Disturber(Disturbance kind, std::uint32_t seed) : kind_(kind), random_(seed) {
    phase_ = between(0, 2 * M_PI);
    rate_ = between(2, 4);
  }

  void operator()(double t, MujocoBackend& backend, ControlCycle& cycle) {
    if (t < kBegin) return;
    mjModel* model = backend.world().model();
    const int body = mj_name2id(model, mjOBJ_BODY, "table");
    mjtNum* height = model->body_pos + 3 * body + 2;
    if (!started_) height_ = *height;
    double offset = 0;
    if (kind_ == Disturbance::wall || kind_ == Disturbance::all) {
      offset += 0.015 * (std::sin(rate_ * (t - kBegin) + phase_) - std::sin(phase_));
    }
    if ((kind_ == Disturbance::loss || kind_ == Disturbance::all) && t > kBegin + 0.5) {
      offset -= t < kBegin + 2 ? 2.0 : 0.03;
    }
    *height = height_ + offset;
    if ((kind_ == Disturbance::jumps || kind_ == Disturbance::all) && t >= next_) {
      jump(cycle);
      next_ = t + between(0.2, 0.8);
    }
    started_ = true;
  }

 private:
  double between(double a, double b) { return std::uniform_real_distribution<double>(a, b)(random_); }

  void jump(ControlCycle& cycle) {
    Instance& law = cycle.modes().instance(cycle.modes().find("wipe"));
    Reference& pose = law.inputs()[law.find_input("pose")];
    if (!started_) home_ = pose.pose();
    Pose X = home_;
    const double up = between(-0.02, 0.04), aside = between(-0.15, 0.15);
    X.position += Vector3(between(-0.05, 0.15), aside, up);
    X.rotation = exp_rotation({between(-0.2, 0.2), between(-0.2, 0.2), between(-0.3, 0.3)}) * X.rotation;
    pose.post(pose_target(X));
    Target force;
    force.size = 6;
    force.values[2] = -between(0, 25);
    law.inputs()[law.find_input("wrench")].post(force);
  }

  Disturbance kind_;
  std::mt19937 random_;
  double phase_, rate_, height_ = 0, next_ = 0;
  bool started_ = false;
  Pose home_;
};

}  // namespace

const char* name(Disturbance disturbance) {
  switch (disturbance) {
    case Disturbance::loss:
      return "loss";
    case Disturbance::wall:
      return "wall";
    case Disturbance::jumps:
      return "jumps";
    case Disturbance::all:
      break;
  }
  return "all";
}

Passivity passivity(Disturbance disturbance, double tank_start_j, bool paper_valve, std::uint32_t seed,
                    const PlantFidelity& plant) {
  Scene scene = task("task_4");
  scene.plant = plant;
  std::erase_if(scene.timeline,
                [](const auto& event) { return event.what == TimelineEvent::What::set_motion; });
  for (auto& event : scene.timeline) {
    if (event.name == "wrench" && disturbance != Disturbance::wall) event.values[2] = -30;
  }
  // At the inputs' own limits the wrist would exceed its velocity limit.
  const Registry registry = Registry::with_builtins();
  for (InputSpec input : registry.controllet("ufic")->descriptor.inputs) {
    if (input.name != "pose") continue;
    input.max_speed = 0.3;
    input.max_angular_speed = 0.5;
    scene.controllets[0].inputs = {input};
  }
  set(scene, "tank_start_j", {tank_start_j});
  set(scene, "valve_law", {paper_valve ? 1.0 : 0.0});
  Disturber disturber(disturbance, seed);
  const Run result = run(
      scene, {.duration_s = kDuration, .each = [&](double t, MujocoBackend& backend, ControlCycle& cycle) {
                disturber(t, backend, cycle);
              }});
  const std::size_t alpha_i = result.column("alpha_i"), force_tank = result.column("force_tank_j"),
                    impedance_tank = result.column("impedance_tank_j"),
                    stored = result.column("stored_energy_j"), injected = result.column("energy_injected_j");
  Passivity figures;
  figures.kept = result.kept && result.fault.empty();
  figures.least_tank = std::numeric_limits<double>::infinity();
  figures.excess = figures.gain = -std::numeric_limits<double>::infinity();
  double first = 0, lowest = std::numeric_limits<double>::infinity();
  Vector3 before = Vector3::Zero();
  std::size_t touching = 0;
  for (std::size_t k = 0; k < result.samples.size(); ++k) {
    const Sample& s = result.samples[k];
    const double S =
        s.kinetic + (1 + s.outputs[alpha_i]) * s.spring + s.outputs[force_tank] + s.outputs[impedance_tank];
    const double made = S - s.environment - kAllowance * s.t;
    if (k == 0) {
      first = made;
    } else {
      figures.moved += (s.p - before).norm();
    }
    before = s.p;
    lowest = std::min(lowest, made);
    figures.excess = std::max(figures.excess, made - first);
    figures.gain = std::max(figures.gain, made - lowest);
    figures.least_tank = std::min({figures.least_tank, s.outputs[force_tank], s.outputs[impedance_tank]});
    figures.injected = s.outputs[injected];
    figures.imbalance = std::max(figures.imbalance, std::abs(S - s.outputs[stored]));
    if (s.F_true.norm() > 0.1) ++touching;
    figures.seconds = s.t;
  }
  figures.contact_share = static_cast<double>(touching) / static_cast<double>(result.samples.size());
  return figures;
}

}  // namespace multipanda::trial
