#include "tests/interaction/trial.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/controllets/cartesian_law.hpp"
#include "core/modes/registry.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "tests/interaction/words.hpp"

namespace multipanda::trial {
namespace {

const Registry& registry() {
  static const Registry builtins = Registry::with_builtins();
  return builtins;
}

// The plant's own joints, without the noise of the measurement.
void true_joints(const MujocoBackend& backend, JointVector& q, JointVector& dq) {
  q.resize(static_cast<Eigen::Index>(backend.world().arm(0).qpos.size()));
  dq.resize(q.size());
  backend.world().joints(0, q, dq);
}

}  // namespace

std::size_t Run::column(const std::string& output) const { return output_column(outputs, output); }

Run run(const Scene& scene, const Options& options) {
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  CycleConfig config = build_cycle_config(scene);
  ModelTerms terms(config.arms[0].model), between(config.arms[0].model);
  ControlCycle cycle(std::move(config), registry(), backend);
  MultimodeController& modes = cycle.modes();
  modes.schedule(build_schedule(scene, modes));
  modes.activate_at_start(start_set(scene, modes));
  const InstanceIndex index = modes.find(scene.controllets[0].name);
  Instance& law = modes.instance(index);

  Run run;
  run.outputs = law.output_specs();
  const double duration = options.duration_s > 0 ? options.duration_s : scene.duration_s;
  const auto steps = static_cast<std::size_t>(std::llround(duration * 1000));
  run.samples.reserve(steps);
  const std::size_t pose = law.find_input("pose"), wrench = law.find_input("wrench");
  const std::size_t stiffness_t = law.find_parameter("translational_stiffness_n_per_m");
  const std::size_t stiffness_r = law.find_parameter("rotational_stiffness_nm_per_rad");

  backend.start();
  JointVector tau_before, q, dq, q_before;
  double environment = 0;
  for (std::size_t k = 0; k < steps; ++k) {
    const double t = static_cast<double>(k) * 1e-3;
    if (options.each) options.each(t, backend, cycle);
    const ArmSet due = backend.wait();
    if (due.empty()) {
      run.fault = backend.fault();
      break;
    }
    true_joints(backend, q, dq);
    cycle.step(due);
    const ArmState& state = cycle.data().state[0];
    terms.set_config(state.frames, state.tool, state.load);
    terms.update(q, dq);

    Sample s;
    s.t = t;
    s.F_true = state.F_K_W_true.force();
    s.F_est = state.F_K_W_est.force();
    s.p = terms.X_WE().position;
    s.v = terms.V_WE().linear();
    s.kinetic = 0.5 * dq.dot(terms.M() * dq);
    // The truth is the mean over the period just gone, so its work is taken over that period's way.
    if (q_before.size() == q.size()) {
      between.set_config(state.frames, state.tool, state.load);
      between.update(0.5 * (q + q_before), dq);
      environment -= state.F_K_W_true.vector.dot(between.J_V_WK() * (q - q_before));
    }
    s.environment = environment;
    if (pose < law.inputs().size()) {
      const Pose& X_d = law.inputs()[pose].pose();
      s.p_d = X_d.position;
      const auto K_t = law.parameter(stiffness_t), K_r = law.parameter(stiffness_r);
      s.spring =
          spring_energy(TaskStiffness::along(Matrix3::Identity(), Vector3(K_t.data()), Vector3(K_r.data())),
                        pose_error(X_d, terms.X_WE()));
    }
    s.F_d = law.inputs()[wrench].vector().head<3>();
    const JointVector tau = cycle.data().tau_controllet[0] + cycle.data().tau_feature[0];
    if (tau_before.size() == tau.size()) s.rate = (tau - tau_before).cwiseAbs().maxCoeff() / 1e-3;
    const auto outputs = law.outputs();
    s.outputs.assign(outputs.begin(), outputs.end());
    run.samples.push_back(std::move(s));
    tau_before = tau;
    q_before = q;
  }
  run.interventions = cycle.safety().counted(0);
  for (std::size_t i = 1; i < static_cast<std::size_t>(Intervention::count_); ++i) {
    const auto rule = static_cast<Intervention>(i);
    if (const auto count = cycle.safety().counted(0, rule); count > 0) {
      run.rules.append(to_string(rule)).append(" ").append(std::to_string(count)).append("; ");
    }
  }
  run.kept = modes.owner(0) == index;
  return run;
}

Scene task(const std::string& name) {
  return load_scene(std::string(MULTIPANDA_SOURCE_DIR) + "/experiments/scenes/" + name + ".yaml", registry());
}

void set(Scene& scene, const std::string& parameter, std::vector<double> values) {
  auto& parameters = scene.controllets[0].parameters;
  std::erase_if(parameters, [&](const auto& value) { return value.name == parameter; });
  parameters.push_back({parameter, std::move(values)});
}

SceneObject& table(Scene& scene) {
  for (auto& object : scene.objects) {
    if (object.name == "table") return object;
  }
  throw std::invalid_argument("no table in " + scene.name);
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
