#pragma once

// For tests: the log of a simulated arm whose joints follow a rich motion.
#include <cmath>
#include <functional>
#include <random>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "scene/build.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda::test {

// Joint motion about the ready pose, a sum of sines (harmonics of 1 / period) with seeded phases: position,
// velocity and acceleration begin at zero offset through a smooth start.
struct RichMotion {
  explicit RichMotion(std::uint64_t seed, double period_s = 10, int harmonics = 5, double reach = 0.35)
      : base(2 * M_PI / period_s) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(-1, 1);
    for (int j = 0; j < 7; ++j) {
      std::vector<std::array<double, 2>> of_joint;
      double total = 0;
      for (int h = 1; h <= harmonics; ++h) {
        of_joint.push_back({any(random), any(random)});
        total += std::hypot(of_joint.back()[0], of_joint.back()[1]) / h;
      }
      for (auto& [a, b] : of_joint) {
        a *= 1.6 * reach / total;
        b *= 1.6 * reach / total;
      }
      waves.push_back(of_joint);
    }
  }
  // q, dq, ddq at t, starting at rest in the ready pose.
  std::array<JointVector, 3> at(double t) const {
    std::array<JointVector, 3> out{ready(), joint_constant(7, 0), joint_constant(7, 0)};
    constexpr double kFade = 1.5;
    const double r = std::min(t / kFade, 1.0);
    const double s = r * r * r * (10 - 15 * r + 6 * r * r);
    const double ds = r < 1 ? 30 * r * r * (1 - r) * (1 - r) / kFade : 0;
    const double dds = r < 1 ? 60 * r * (1 - r) * (1 - 2 * r) / (kFade * kFade) : 0;
    for (std::size_t j = 0; j < 7; ++j) {
      double p = 0, v = 0, a = 0;
      for (std::size_t h = 1; h <= waves[j].size(); ++h) {
        const double w = base * static_cast<double>(h);
        const auto [x, y] = waves[j][h - 1];
        const double n = static_cast<double>(h);
        p += (x * std::sin(w * t) + y * std::cos(w * t)) / n;
        v += w * (x * std::cos(w * t) - y * std::sin(w * t)) / n;
        a -= w * w * (x * std::sin(w * t) + y * std::cos(w * t)) / n;
      }
      const auto i = static_cast<Eigen::Index>(j);
      out[0][i] += s * p;
      out[1][i] = ds * p + s * v;
      out[2][i] = dds * p + 2 * ds * v + s * a;
    }
    return out;
  }
  double base;
  std::vector<std::vector<std::array<double, 2>>> waves;
};

struct RecordOptions {
  double duration_s = 10;
  double dither_nm = 0;  // of each of three sines between 8 and 60 Hz, per joint, scaled by the joint's limit
  double part_of_period_late = 0;  // commands arrive later by this part of a period than the log says
};

// Commands that follow the motion: computed torque with the arm's own model, as a controllet
// would compute it.
inline MeasuredLog record(const Scene& scene, const RichMotion& motion, const RecordOptions& options = {}) {
  Loop loop(scene);
  loop.unwatch();
  ModelTerms terms(build_arm_model(scene.arms[0]));
  const ArmConfig config = arm_config(scene.arms[0]);
  terms.set_config(config.frames, config.tool, config.load);
  const auto n = static_cast<Eigen::Index>(scene.arms[0].q_start.size());
  const auto rows = static_cast<Eigen::Index>(std::lround(1000 * options.duration_s));
  MeasuredLog log;
  log.source = "simulated";
  log.arm = scene.arms[0].name;
  log.t.resize(rows);
  for (auto* m : {&log.q, &log.dq, &log.tau, &log.tau_d, &log.tau_cmd, &log.gravity}) m->resize(rows, n);
  JointVector last = joint_constant(static_cast<std::size_t>(n), 0);
  for (Eigen::Index k = 0; k < rows; ++k) {
    const double t = 0.001 * static_cast<double>(k);
    const ArmState& state = loop.state();
    terms.update(state.q, state.dq);
    const auto [q, dq, ddq] = motion.at(t);
    JointVector tau = terms.M() * (ddq + 15 * (dq - state.dq) + 60 * (q - state.q)) + terms.c();
    for (Eigen::Index j = 0; j < n; ++j) {
      const double x = static_cast<double>(j);
      const double size = options.dither_nm * (j < 4 ? 1.0 : 0.3);
      tau[j] += size * (std::sin(2 * M_PI * (8 + x) * t) + std::sin(2 * M_PI * (23 + 2 * x) * t + x) +
                        std::sin(2 * M_PI * (47 + 2 * x) * t + 2 * x));
    }
    log.t[k] = t;
    log.q.row(k) = state.q;
    log.dq.row(k) = state.dq;
    log.tau.row(k) = state.tau_J;
    log.tau_d.row(k) = state.tau_J_d;
    log.tau_cmd.row(k) = tau;
    log.gravity.row(k) = terms.g();
    loop.commands[0].tau_cmd =
        (1 - options.part_of_period_late) * tau + options.part_of_period_late * (k > 0 ? last : tau);
    last = tau;
    loop.step();
  }
  return log;
}

// A tool that presses on a table with 15 +- `amplitude` N.
struct Pressed {
  Scene scene;
  MeasuredLog log;
};

inline Pressed press(double stiffness, const ToolShape& tool, double friction, std::uint64_t seed,
                     double payload = 0, double amplitude = 10) {
  SceneArm arm = arm_named("a", {}, false);
  arm.tool_shapes = {tool};
  const double reach =
      tool.X_FS.position.z() + 0.5 * (tool.shape == ShapeType::box ? tool.size.z() : tool.size.x());
  arm.X_FE = pose(0, 0, reach);
  if (payload > 0)
    arm.load_present = {.mass = payload, .p_FC = {0, 0, 0.05}, .inertia_C = 5e-4 * Matrix3::Identity()};
  ModelTerms terms = terms_of(arm);
  terms.set_config({*arm.X_FE, {}}, {}, {});
  terms.update(arm.q_start, joint_constant(7, 0));
  const Pose X_WE = terms.X_WE();
  SceneObject table;
  table.name = "table";
  table.size = {0.3, 0.3, 0.1};
  table.X_WO = {X_WE.rotation, X_WE.position + 0.05 * X_WE.rotation.col(2)};
  table.contact = SurfaceContact{.stiffness_n_per_m = stiffness, .damping_ratio = 0.5};
  table.friction = friction;
  PlantFidelity noisy;
  noisy.noise_q_rad = 1e-5;
  noisy.noise_dq_rad_per_s = 1e-3;
  noisy.noise_tau_nm = 0.05;
  Pressed p{.scene = scene_of({arm}, noisy), .log = {}};
  p.scene.seed = seed;
  p.scene.objects = {table};
  Loop loop(p.scene);
  loop.unwatch();
  constexpr Eigen::Index kRows = 6000;
  MeasuredLog& log = p.log;
  log.source = "pressed";
  log.t.resize(kRows);
  for (auto* m : {&log.q, &log.dq, &log.tau, &log.gravity}) m->resize(kRows, 7);
  for (Eigen::Index k = 0; k < kRows; ++k) {
    const double t = 0.001 * static_cast<double>(k);
    terms.update(loop.state());
    Vector6 push = Vector6::Zero();
    push.head<3>() = (15 + amplitude * std::sin(2 * M_PI * 0.8 * t)) * X_WE.rotation.col(2);
    loop.commands[0].tau_cmd = terms.J_V_WE().transpose() * push -
                               terms.M() * (40 * loop.state().dq + 400 * (loop.state().q - arm.q_start));
    log.t[k] = t;
    log.q.row(k) = loop.state().q;
    log.dq.row(k) = loop.state().dq;
    log.tau.row(k) = loop.state().tau_J;
    loop.step();
  }
  return p;
}

inline ToolShape ball() {
  return {.shape = ShapeType::sphere, .size = Vector3(0.04, 0, 0), .X_FS = pose(0, 0, 0.2)};
}
inline ToolShape pad() {
  return {.shape = ShapeType::box, .size = {0.06, 0.06, 0.02}, .X_FS = pose(0, 0, 0.1)};
}

}  // namespace multipanda::test
