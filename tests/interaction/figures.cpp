#include "tests/interaction/figures.hpp"

#include <algorithm>

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

}  // namespace multipanda::trial
