#include "tests/interaction/figures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "core/controllets/cartesian_law.hpp"

namespace multipanda::trial {

namespace {

constexpr double kTaskDuration = 10, kSettling = 1.5;  // [s]

void lay(Scene& scene, const Surface& surface) {
  SceneObject& object = interaction::object(scene, "table");
  object.friction = surface.friction;
  object.contact->stiffness_n_per_m = surface.stiffness;
  object.contact->damping_ratio = surface.damping_ratio;
}

}  // namespace

TaskFigures task_figures(const std::string& name, const PlantFidelity& plant, const Surface& surface,
                         const Change& change) {
  Scene scene = task(name);
  scene.plant = plant;
  lay(scene, surface);
  if (change) change(scene);
  const Run result = run(scene);
  const double from = task_start(scene), to = from + kTaskDuration;
  TaskFigures figures;
  figures.contact_s = first_contact(result);
  figures.force_rms = rms(result, from, to, force_error);
  figures.force_max = largest(result, from, to, [](const Sample& s) { return std::abs(force_error(s)); });
  figures.estimate_rms = rms(result, from, to, estimate_error);
  figures.path_rms = rms(result, from, to, path_error);
  figures.path_max = largest(result, from, to, path_error);
  const auto rate = [](const Sample& s) { return s.rate; };
  figures.peak = largest(result, figures.contact_s, figures.contact_s + 0.3, pressing);
  figures.rate_task = largest(result, from, to, rate);
  figures.rate_contact = largest(result, figures.contact_s - 0.01, figures.contact_s + 0.5, rate);
  figures.interventions = result.interventions;
  figures.good = result.kept && result.fault.empty() && figures.contact_s <= from - kSettling &&
                 !result.samples.empty() && result.samples.back().t >= to - 0.01;
  return figures;
}

LossFigures loss_figures(const std::string& name, double force, const Change& change) {
  Scene scene = task(name);
  constexpr double kGone = 4.0;
  std::erase_if(scene.timeline, [](const auto& event) { return event.at_s > 1; });
  for (auto& event : scene.timeline) {
    if (event.name == "wrench") event.values[2] = -force;
  }
  TimelineEvent gone;
  gone.at_s = kGone;
  gone.what = TimelineEvent::What::place;
  gone.object = "table";
  gone.X_WO.position = {0.4, 0, -2};
  scene.timeline.push_back(gone);
  if (change) change(scene);
  const Run result = run(scene, {.duration_s = kGone + 3});
  LossFigures figures;
  const double height = result.samples.at(static_cast<std::size_t>(kGone * 1000)).p.z();
  figures.speed = largest(result, kGone, kGone + 3, [](const Sample& s) { return s.v.norm(); });
  figures.drop = largest(result, kGone, kGone + 3, [&](const Sample& s) { return height - s.p.z(); });
  figures.interventions = result.interventions;
  const double pressed = -result.samples[static_cast<std::size_t>(kGone * 1000) - 1].F_true.z();
  figures.pressed = pressed;
  figures.good = result.kept && result.fault.empty() && std::abs(pressed - force) < 0.05 * force;
  return figures;
}

void paper_preset(Scene& scene) {
  set(scene, "valve_law", {1});
  set(scene, "translational_stiffness_n_per_m", {100, 100, 50});
  set(scene, "rotational_stiffness_nm_per_rad", {10, 10, 10});
  set(scene, "force_proportional", {1});
  set(scene, "force_derivative_s", {0.05});
  set(scene, "force_integral_per_s", {0.25});
  set(scene, "force_damping_n_s_per_m", {0});
  set(scene, "tangential_gain", {0});
  set(scene, "d_max_m", {0.05});
}

Run run(const Scene& scene, const Options& options) {
  Run run;
  const auto add = [&run](interaction::PlantSample measured, const interaction::Loop& loop) {
    Instance& law = loop.law;
    const ArmState& state = loop.cycle.data().state[0];
    ModelTerms& terms = loop.terms[0];
    Sample s{std::move(measured)};
    s.F_true = state.F_K_W_true.force();
    s.F_est = state.F_K_W_est.force();
    s.p = terms.X_WE().position;
    s.v = terms.V_WE().linear();
    if (const std::size_t pose = law.find_input("pose"); pose < law.inputs().size()) {
      const Pose& X_d = law.inputs()[pose].pose();
      s.p_d = X_d.position;
      const auto K_t = law.parameter(law.find_parameter("translational_stiffness_n_per_m")),
                 K_r = law.parameter(law.find_parameter("rotational_stiffness_nm_per_rad"));
      s.spring =
          spring_energy(TaskStiffness::along(Matrix3::Identity(), Vector3(K_t.data()), Vector3(K_r.data())),
                        pose_error(X_d, terms.X_WE()));
    }
    s.F_d = law.inputs()[law.find_input("wrench")].vector().head<3>();
    run.samples.push_back(std::move(s));
  };
  static_cast<interaction::Outcome&>(run) =
      interaction::run_closed_loop(scene, options.duration_s, options.each, add);
  return run;
}

double task_start(const Scene& scene) {
  for (const auto& event : scene.timeline) {
    if (event.what == TimelineEvent::What::set_motion) return event.at_s;
  }
  throw std::invalid_argument("no motion in " + scene.name);
}

double rms(const Run& run, double from, double to, const std::function<double(const Sample&)>& value) {
  double sum = 0;
  std::size_t count = 0;
  for (const auto& s : run.samples) {
    if (s.t < from || s.t >= to) continue;
    sum += value(s) * value(s);
    ++count;
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : std::nan("");
}

double largest(const Run& run, double from, double to, const std::function<double(const Sample&)>& value) {
  double most = -std::numeric_limits<double>::infinity();
  for (const auto& s : run.samples) {
    if (s.t >= from && s.t < to) most = std::max(most, value(s));
  }
  return most;
}

double first_contact(const Run& run) {
  for (const auto& s : run.samples) {
    if (s.F_true.norm() > 0.5) return s.t;
  }
  return std::numeric_limits<double>::infinity();
}

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
