#include "tests/teleoperation/pairs.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "core/modes/registry.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "tests/teleoperation/operator.hpp"

namespace multipanda::teleoperation {
namespace {

// Leaders are arms 0 and 2, followers 1 and 3; all bases are turned and off the origin.
const char* const kBases[] = {
    "{position_m: [-0.9, 0.9, 0.1], rpy_rad: [0, 0, 0.7]}",
    "{position_m: [0.9, 0.9, 0.05], rpy_rad: [0, 0, -0.5]}",
    "{position_m: [-0.9, -0.9, 0], rpy_rad: [0, 0, 1.2]}",
    "{position_m: [0.9, -0.9, 0.02], rpy_rad: [0, 0, 0.3]}",
};

std::string text_of(const Pairs& pairs) {
  std::string arms = "arms:\n", laws = "controllets:\n", active;
  for (int i = 0; i < 4; ++i) {
    arms.append("  - {name: arm_").append(std::to_string(i));
    arms.append(", model: fer, hand: false, base: ").append(kBases[i]);
    arms.append(", end_effector: {position_m: [0, 0, 0.22], rpy_rad: [0, 0, -pi/4]}, tool: {mass_kg: 0.7, ");
    arms.append("com_m: [0, 0, 0.1], inertia_kg_m2: {xx: 0.0024, yy: 0.0024, zz: 0.0003}}}\n");
  }
  for (std::size_t k = 0; k < 2; ++k) {
    const std::string number = std::to_string(k), leader = "arm_" + std::to_string(2 * k),
                      follower = "arm_" + std::to_string(2 * k + 1);
    if (!active.empty()) active += ", ";
    if (pairs.laws[k] == "teleoperation") {
      laws.append("  - {name: law_").append(number).append(", type: teleoperation, arms: [");
      laws.append(leader).append(", ").append(follower).append("]}\n");
    } else {
      laws.append("  - {name: lead_").append(number).append(", type: gravity_compensation, arms: ");
      laws.append(leader).append("}\n  - {name: law_").append(number).append(", type: ");
      laws.append(pairs.laws[k]).append(", arms: ").append(follower);
      laws.append(", observes: ").append(leader).append("}\n");
      active.append("lead_").append(number).append(", ");
    }
    active.append("law_").append(number);
  }
  return arms + laws + "active: [" + active + "]\n";
}

// Up to 0.2 m/s and 0.4 m/s^2, along all axes; each person leads elsewhere.
Vector3 way(std::size_t pair, double t) {
  const double u = std::clamp((t - 0.5) / 2, 0.0, 1.0), rise = u * u * u * (10 + u * (6 * u - 15));
  const double w = pair == 0 ? 1 : 0.8;
  return rise * Vector3(0.05 * std::sin(2.4 * w * t), 0.06 * (1 - std::cos(1.9 * w * t)),
                        0.04 * std::sin(2.9 * w * t));
}

}  // namespace

PairsOutcome run(const Pairs& pairs) {
  static const Registry registry = Registry::with_builtins();
  Scene scene = parse_scene(text_of(pairs), "pairs.yaml", registry);
  scene.plant = pairs.plant;
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  ControlCycle cycle(build_cycle_config(scene), registry, backend);
  MultimodeController& modes = cycle.modes();
  modes.activate_at_start(start_set(scene, modes));

  std::vector<Operator> persons;
  std::vector<ModelTerms> terms;
  std::vector<Pose> X_start;
  std::vector<JointVector> q, dq;
  for (const SceneArm& arm : scene.arms) {
    if (terms.size() % 2 == 0) persons.emplace_back(arm, terms.size());
    const ArmConfig config = arm_config(arm);
    terms.emplace_back(build_arm_model(arm));
    terms.back().set_config(config.frames, config.tool, config.load);
    q.push_back(arm.q_start);
    dq.push_back(JointVector::Zero(arm.q_start.size()));
    terms.back().update(q.back(), dq.back());
    X_start.push_back(terms.back().X_WE());
  }
  PairsOutcome outcome;
  backend.start();
  for (int step = 0; step < 7000; ++step) {
    const double t = 1e-3 * step;
    for (std::size_t k = 0; k < 2; ++k) {
      Pose X = persons[k].start();
      const Matrix3 R_leader = scene.arms[2 * k].X_WB.rotation;
      if (pairs.moves[k]) X.position += R_leader * way(k, t);
      persons[k].apply(backend, X);
    }
    cycle.step(backend.wait());
    for (std::size_t i = 0; i < 4; ++i) {
      backend.world().joints(i, q[i], dq[i]);
      terms[i].update(q[i], dq[i]);
    }
    for (std::size_t k = 0; k < 2; ++k) {
      const std::size_t l = 2 * k, f = l + 1;
      const Matrix3 R_map = scene.arms[f].X_WB.rotation * scene.arms[l].X_WB.rotation.transpose();
      const Vector3 led = R_map * (terms[l].X_WE().position - X_start[l].position);
      const Vector3 followed = terms[f].X_WE().position - X_start[f].position;
      PairOutcome& pair = outcome.pairs[k];
      pair.way = std::max(pair.way, led.norm());
      pair.follower_way = std::max(pair.follower_way, followed.norm());
      pair.hand_error = std::max(pair.hand_error, (led - followed).norm());
      pair.joint_error = std::max(pair.joint_error, (q[f] - q[l]).lpNorm<Eigen::Infinity>());
    }
  }
  for (ArmIndex arm = 0; arm < 4; ++arm) {
    const std::size_t k = arm / 2;
    const bool led = arm % 2 == 0 && pairs.laws[k] != "teleoperation";
    const InstanceIndex owner = modes.find((led ? "lead_" : "law_") + std::to_string(k));
    outcome.pairs[k].kept = outcome.pairs[k].kept && modes.owner(arm) == owner;
    for (std::size_t i = 1; i < static_cast<std::size_t>(Intervention::count_); ++i) {
      const auto rule = static_cast<Intervention>(i);
      if (cycle.safety().counted(arm, rule) > 0)
        outcome.interventions.append(to_string(rule)).append(" of arm ").append(std::to_string(arm)) += "; ";
    }
  }
  return outcome;
}

}  // namespace multipanda::teleoperation
