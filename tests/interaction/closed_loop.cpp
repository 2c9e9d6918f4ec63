#include "tests/interaction/closed_loop.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/modes/registry.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::interaction {
namespace {

const Registry& registry() {
  static const Registry builtins = Registry::with_builtins();
  return builtins;
}

void set_state(ModelTerms& terms, const ArmState& state, const JointVector& q, const JointVector& dq) {
  terms.set_config(state.frames, state.tool, state.load);
  terms.update(q, dq);
}

}  // namespace

std::size_t Outcome::column(const std::string& output) const {
  std::size_t at = 0;
  for (const auto& spec : outputs) {
    if (spec.name == output) return at;
    at += spec.size;
  }
  throw std::invalid_argument("no output " + output);
}

Outcome run_closed_loop(const Scene& scene, double duration_s, const BeforeStep& before,
                        const AfterStep& after) {
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  CycleConfig config = build_cycle_config(scene);
  std::vector<ModelTerms> terms, between;
  for (const auto& arm : config.arms) {
    terms.emplace_back(arm.model);
    between.emplace_back(arm.model);
  }
  const std::size_t arms = terms.size();
  ControlCycle cycle(std::move(config), registry(), backend);
  MultimodeController& modes = cycle.modes();
  modes.schedule(build_schedule(scene, modes));
  modes.activate_at_start(start_set(scene, modes));
  const InstanceIndex index = modes.find(scene.controllets[0].name);
  Instance& law = modes.instance(index);

  Outcome outcome;
  outcome.outputs = law.output_specs();
  const double duration = duration_s > 0 ? duration_s : scene.duration_s;
  const auto steps = static_cast<std::size_t>(std::llround(duration * 1000));
  backend.start();
  std::vector<JointVector> q(arms), dq(arms), q_before(arms), tau_before(arms);
  double environment = 0;
  for (std::size_t k = 0; k < steps; ++k) {
    PlantSample s;
    s.t = static_cast<double>(k) * 1e-3;
    if (before) before(s.t, backend, cycle);
    const ArmSet due = backend.wait();
    if (due.empty()) {
      outcome.fault = backend.fault();
      break;
    }
    for (std::size_t i = 0; i < arms; ++i) {
      q[i].resize(static_cast<Eigen::Index>(backend.world().arm(i).qpos.size()));
      dq[i].resize(q[i].size());
      backend.world().joints(i, q[i], dq[i]);
    }
    cycle.step(due);
    for (std::size_t i = 0; i < arms; ++i) {
      const ArmState& state = cycle.data().state[i];
      set_state(terms[i], state, q[i], dq[i]);
      s.kinetic += 0.5 * dq[i].dot(terms[i].M() * dq[i]);
      const JointVector tau = cycle.data().tau_controllet[i] + cycle.data().tau_feature[i];
      if (k > 0) {
        // The true force is the mean over the last period, so its work is taken over that period's motion.
        set_state(between[i], state, 0.5 * (q[i] + q_before[i]), dq[i]);
        environment -= state.F_K_W_true.vector.dot(between[i].J_V_WK() * (q[i] - q_before[i]));
        s.rate = std::max(s.rate, (tau - tau_before[i]).cwiseAbs().maxCoeff() / 1e-3);
      }
      tau_before[i] = tau;
      q_before[i] = q[i];
    }
    s.environment = environment;
    const auto outputs = law.outputs();
    s.outputs.assign(outputs.begin(), outputs.end());
    after(std::move(s), {backend, cycle, law, terms});
  }
  for (ArmIndex arm = 0; arm < arms; ++arm) {
    outcome.interventions += cycle.safety().counted(arm);
    outcome.kept = outcome.kept && modes.owner(arm) == index;
    for (std::size_t i = 1; i < static_cast<std::size_t>(Intervention::count_); ++i) {
      const auto rule = static_cast<Intervention>(i);
      if (const auto count = cycle.safety().counted(arm, rule); count > 0) {
        outcome.rules.append(to_string(rule)).append(" ").append(std::to_string(count)).append("; ");
      }
    }
  }
  return outcome;
}

Scene task(const std::string& name) {
  return load_scene(std::string(MULTIPANDA_SOURCE_DIR) + "/experiments/scenes/" + name + ".yaml", registry());
}

void set(Scene& scene, const std::string& parameter, std::vector<double> values) {
  auto& parameters = scene.controllets[0].parameters;
  std::erase_if(parameters, [&](const auto& value) { return value.name == parameter; });
  parameters.push_back({parameter, std::move(values)});
}

SceneObject& object(Scene& scene, const std::string& name) {
  for (auto& candidate : scene.objects) {
    if (candidate.name == name) return candidate;
  }
  throw std::invalid_argument("no " + name + " in " + scene.name);
}

}  // namespace multipanda::interaction
