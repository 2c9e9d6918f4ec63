#include "tests/interaction/grasp_trial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace multipanda::grasp {
namespace {

constexpr double kSettling = 3, kTask = 10;  // [s]

SceneObject& box(Scene& scene) { return interaction::object(scene, "box"); }

}  // namespace

Run run(const Scene& scene, const Disturbance& each) {
  Run run;
  const auto before = [&each](double t, MujocoBackend& backend, ControlCycle&) {
    if (each) each(t, backend);
  };
  const auto add = [&run](interaction::PlantSample measured, const interaction::Loop& loop) {
    Sample s{std::move(measured)};
    const auto& states = loop.cycle.data().state;
    s.X_WO = loop.backend.world().X_WO(*loop.backend.world().find_object("box"));
    for (std::size_t i = 0; i < 2; ++i) s.X_WE[i] = loop.terms[i].X_WE();
    const Vector3 n = (s.X_WE[1].position - s.X_WE[0].position).normalized();
    for (std::size_t i = 0; i < 2; ++i) {
      const double sign = i == 0 ? 1 : -1;
      s.push[i] = sign * n.dot(Vector3(states[i].F_K_W_true.force()));
      s.push_est[i] = sign * n.dot(Vector3(states[i].F_K_W_est.force()));
    }
    s.p_d = loop.law.inputs()[loop.law.find_input("pose")].pose().position;
    s.squeeze_d = loop.law.inputs()[loop.law.find_input("squeeze")].scalar();
    run.samples.push_back(std::move(s));
  };
  static_cast<interaction::Outcome&>(run) = interaction::run_closed_loop(scene, 0, before, add);
  return run;
}

Scene task() { return interaction::task("task_5"); }

void vary(Scene& scene, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto draw = [&](double size) { return std::uniform_real_distribution<double>(-size, size)(random); };
  SceneObject& object = box(scene);
  object.X_WO.position.x() += draw(0.003);
  object.X_WO.position.y() += draw(0.003);
  object.X_WO.rotation = rotation_from_rpy({0, 0, draw(0.02)}) * object.X_WO.rotation;
  object.mass *= 1 + draw(0.02);
  scene.seed = seed;
}

Figures figures(const Run& run) {
  Figures figures;
  figures.grasp_s = std::numeric_limits<double>::infinity();
  const std::size_t contact = run.column("in_contact");
  const std::size_t estimated = run.column("force_estimated_n");
  for (const auto& s : run.samples) {
    if (s.outputs[contact] > 0.5 && s.outputs[run.column("phase")] > 1.5) {
      figures.grasp_s = s.t;
      break;
    }
  }
  figures.interventions = run.interventions;
  const double from = figures.grasp_s + kSettling, to = from + kTask;
  std::array<double, 2> sum{};
  double sum_estimate = 0;
  std::size_t count = 0;
  figures.least = std::numeric_limits<double>::infinity();
  figures.most = -figures.least;
  const Sample* first = nullptr;
  std::array<Vector3, 2> p_OC;  // the point of the box under the middle of each pad
  for (const auto& s : run.samples) {
    double& rate = s.t < from ? figures.rate_grasp : figures.rate_task;
    if (s.t > 0.3 && s.t < to) rate = std::max(rate, s.rate);
    if (s.t < from || s.t >= to) continue;
    if (first == nullptr) {
      first = &s;
      for (std::size_t i = 0; i < 2; ++i) p_OC[i] = s.X_WO.inverse() * s.X_WE[i].position;
    }
    ++count;
    for (std::size_t i = 0; i < 2; ++i) {
      const double e = s.push[i] - s.squeeze_d;
      sum[i] += e * e;
      figures.least = std::min(figures.least, s.push[i]);
      figures.most = std::max(figures.most, s.push[i]);
      const Vector3 moved = s.X_WE[i].inverse() * (s.X_WO * p_OC[i]);
      figures.slip = std::max(figures.slip, moved.head<2>().norm());  // z of E: out of the pad
    }
    const double e = s.outputs[estimated] - s.squeeze_d;
    sum_estimate += e * e;
    figures.uneven = std::max(figures.uneven, std::abs(s.push[0] - s.push[1]));
    figures.tilt =
        std::max(figures.tilt, log_rotation(s.X_WO.rotation * first->X_WO.rotation.transpose()).norm());
    const double rise = s.X_WO.position.z() - first->X_WO.position.z();
    figures.lift = std::max(figures.lift, rise);
    figures.lift_error = std::max(figures.lift_error, std::abs(rise - (s.p_d.z() - first->p_d.z())));
  }
  const auto mean = [&](double total) { return std::sqrt(total / static_cast<double>(count)); };
  figures.rms = mean(std::max(sum[0], sum[1]));
  figures.estimate_rms = mean(sum_estimate);
  figures.held = run.kept && run.fault.empty() && count > 9900 && figures.least > 5;
  return figures;
}

// Springs and tanks of the law, kinetic energy of the plant, minus the energy from the contacts.
std::vector<double> energies(const Run& run) {
  const std::size_t stored = run.column("stored_energy_j"), kinetic = run.column("kinetic_energy_j");
  std::vector<double> energies;
  for (const auto& s : run.samples) {
    energies.push_back(s.outputs[stored] - s.outputs[kinetic] + s.kinetic - s.environment);
  }
  return energies;
}

double energy_excess(const Run& run, double allowed_w) {
  const auto energy = energies(run);
  double most = -std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < energy.size(); ++k) {
    most = std::max(most, energy[k] - energy[0] - allowed_w * run.samples[k].t);
  }
  return most;
}

double energy_gain(const Run& run) {
  double gain = 0, least = std::numeric_limits<double>::infinity();
  for (const double energy : energies(run)) {
    least = std::min(least, energy);
    gain = std::max(gain, energy - least);
  }
  return gain;
}

void paper_gains(Scene& scene, bool its_force_gains) {
  set(scene, "translational_stiffness_n_per_m", {200, 200, 100});  // of the object: both arms
  set(scene, "rotational_stiffness_nm_per_rad", {20, 20, 20});
  set(scene, "relative_translational_stiffness_n_per_m", {50, 50, 25});  // two springs in series
  set(scene, "relative_rotational_stiffness_nm_per_rad", {5, 5, 5});
  set(scene, "object_mass_kg", {0});
  set(scene, "vertical_integral_n_per_m_s", {0});
  // The softer spring closes the hands later.
  constexpr double kLater = 2.0;
  scene.duration_s += kLater;
  for (auto& event : scene.timeline) {
    if (event.what == TimelineEvent::What::set_motion) event.at_s += kLater;
  }
  if (!its_force_gains) return;
  set(scene, "force_proportional", {1});
  set(scene, "force_derivative_s", {0.05});
  set(scene, "force_integral_per_s", {0.25});
  set(scene, "squeeze_damping_n_s_per_m", {0});
}

Run disturbed(Scene scene, std::uint32_t seed) {
  constexpr double kFrom = 6, kTo = 11;
  std::mt19937 random(seed);
  const auto draw = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::erase_if(scene.timeline,
                [](const auto& event) { return event.what == TimelineEvent::What::set_motion; });
  for (double t = kFrom; t < kTo; t += draw(0.1, 0.8)) {
    TimelineEvent jump;
    jump.at_s = t;
    jump.what = TimelineEvent::What::set_reference;
    jump.controllet = scene.controllets[0].name;
    jump.name = "pose";
    jump.duration_s = 0.4;  // faster ones end at the joints' speed limit
    const Quaternion q(exp_rotation({draw(-0.1, 0.1), draw(-0.1, 0.1), draw(-0.1, 0.1)}));
    jump.values = {draw(0.46, 0.54), draw(-0.04, 0.04), draw(0.37, 0.45), q.w(), q.x(), q.y(), q.z()};
    scene.timeline.push_back(jump);
  }
  struct Pull {
    double at = 0;
    Vector3 force;
  };
  std::vector<Pull> pulls;
  for (double t = kFrom; t < kTo; t += draw(0.1, 0.6)) {
    pulls.push_back({t, {draw(-8, 8), draw(-8, 8), draw(-8, 8)}});
  }
  pulls.push_back({kTo, Vector3::Zero()});
  scene.duration_s = kTo + 2;
  return run(scene, [&](double t, MujocoBackend& backend) {
    const World& world = backend.world();
    const int body = world.objects()[*world.find_object("box")].body;
    for (const auto& pull : pulls) {
      if (t < pull.at) break;
      for (int i = 0; i < 3; ++i) backend.world().data()->xfrc_applied[6 * body + i] = pull.force[i];
    }
  });
}

Pushed push_box(Scene scene, const Vector3& force) {
  // The table is removed, so that only the hands hold the box.
  constexpr double kTableGone = 5.5, kPush = 6.5, kEnd = 11.5;
  std::erase_if(scene.timeline,
                [](const auto& event) { return event.what == TimelineEvent::What::set_motion; });
  TimelineEvent gone;
  gone.at_s = kTableGone;
  gone.what = TimelineEvent::What::place;
  gone.object = "table";
  gone.X_WO.position = {0.5, 0, -2};
  scene.timeline.push_back(gone);
  scene.duration_s = kEnd;
  const Run result = run(scene, [&](double t, MujocoBackend& backend) {
    const World& world = backend.world();
    const int body = world.objects()[*world.find_object("box")].body;
    // The force rises over half a second, so that nothing swings.
    const double share = std::clamp((t - kPush) / 0.5, 0.0, 1.0);
    for (int i = 0; i < 3; ++i) backend.world().data()->xfrc_applied[6 * body + i] = share * force[i];
  });
  Pushed pushed;
  const auto mean = [&](double from, double to, auto&& value) {
    auto sum = value(result.samples[0]);
    sum *= 0;
    double count = 0;
    for (const auto& s : result.samples) {
      if (s.t < from || s.t >= to) continue;
      sum += value(s);
      ++count;
    }
    sum /= count;
    return sum;
  };
  const auto box_at = [](const Sample& s) -> Vector3 { return s.X_WO.position; };
  const auto hand = [](std::size_t i) {
    return [i](const Sample& s) -> Vector3 { return s.X_WE[i].position; };
  };
  pushed.kept = result.kept && result.fault.empty() && result.samples.size() > 11000;
  if (!pushed.kept) return pushed;
  pushed.box = mean(kEnd - 0.5, kEnd, box_at) - mean(kPush - 0.5, kPush, box_at);
  for (std::size_t i = 0; i < 2; ++i) {
    pushed.hand[i] = mean(kEnd - 0.5, kEnd, hand(i)) - mean(kPush - 0.5, kPush, hand(i));
    pushed.squeeze[i] = mean(kEnd - 0.5, kEnd, [i](const Sample& s) { return s.push[i]; });
  }
  for (const auto& s : result.samples) {
    if (s.t < kPush) continue;
    pushed.worst_mean = std::max(pushed.worst_mean, std::abs(0.5 * (s.push[0] + s.push[1]) - s.squeeze_d));
  }
  return pushed;
}

Loss box_vanishes(Scene scene, double at_s) {
  TimelineEvent gone;
  gone.at_s = at_s;
  gone.what = TimelineEvent::What::place;
  gone.object = "box";
  gone.X_WO.position = {2, 0, 0.1};
  scene.timeline.push_back(gone);
  std::stable_sort(scene.timeline.begin(), scene.timeline.end(),
                   [](const auto& a, const auto& b) { return a.at_s < b.at_s; });
  scene.duration_s = at_s + 4;
  const Run result = run(scene);
  Loss loss;
  loss.energy_excess = energy_excess(result, 1e-3);
  loss.energy_gain = energy_gain(result);
  loss.interventions = result.interventions;
  loss.kept = result.kept && result.fault.empty();
  const auto at = static_cast<std::size_t>(std::llround(at_s * 1000));
  const auto& samples = result.samples;
  if (samples.size() <= at) return loss;
  loss.squeezed = 0.5 * (samples[at - 1].push[0] + samples[at - 1].push[1]);
  const auto distance = [](const Sample& s) { return (s.X_WE[1].position - s.X_WE[0].position).norm(); };
  for (std::size_t k = at; k < samples.size(); ++k) {
    for (std::size_t i = 0; i < 2; ++i) {
      const double speed = (samples[k].X_WE[i].position - samples[k - 1].X_WE[i].position).norm() / 1e-3;
      loss.speed = std::max(loss.speed, speed);
    }
    loss.closed = std::max(loss.closed, distance(samples[at - 1]) - distance(samples[k]));
    loss.rate = std::max(loss.rate, samples[k].rate);
  }
  return loss;
}

}  // namespace multipanda::grasp
