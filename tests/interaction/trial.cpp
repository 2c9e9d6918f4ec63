#include "tests/interaction/trial.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/controllets/cartesian_law.hpp"

namespace multipanda::trial {
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

}  // namespace multipanda::trial
