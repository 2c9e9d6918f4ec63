#include "backends/mujoco/testing/forces_rig.hpp"

#include <numbers>

#include "scene/build.hpp"

namespace multipanda::test {
namespace {

constexpr double kGravity = 9.81;
constexpr int kSettle = 1500, kWindow = 500;  // [periods]

std::vector<ModelTerms> all_terms(const Scene& scene) {
  std::vector<ModelTerms> terms;
  for (const auto& arm : scene.arms) terms.emplace_back(build_arm_model(arm));
  return terms;
}

// Collects errors, three components each.
class Errors {
 public:
  void add(const Vector3& error) {
    sum_ += error;
    squares_ += error.squaredNorm();
    max_ = std::max(max_, error.norm());
    ++count_;
  }
  ErrorFigures figures() const {
    return {.bias = (sum_ / count_).norm(), .rms = std::sqrt(squares_ / count_), .max = max_};
  }

 private:
  Vector3 sum_ = Vector3::Zero();
  double squares_ = 0, max_ = 0, count_ = 0;
};

class WrenchErrors {
 public:
  void add(const ArmState& state, const Wrench& truth) {
    force_.add(state.F_K_W_est.force() - truth.force());
    torque_.add(state.F_K_W_est.torque() - truth.torque());
  }
  WrenchError figures() const { return {force_.figures(), torque_.figures()}; }

 private:
  Errors force_, torque_;
};

Wrench reaction(const Wrench& F) {
  Wrench minus;
  minus.vector = -F.vector;
  return minus;
}

Load block(double mass, const Vector3& p_FC) {
  Load load{.mass = mass, .p_FC = p_FC};
  load.inertia_C = (mass * 0.002) * Vector3(1, 1.5, 1.2).asDiagonal();
  return load;
}

Pose base_for(const SceneArm& arm, const Pose& X_WF) {
  ModelTerms terms = terms_of(arm_named("any", {}, arm.hand));
  terms.update(ready(), joint_constant(7, 0));
  return X_WF * terms.X_WF().inverse();
}

}  // namespace

ForceRig::ForceRig(const Scene& scene) : loop_(scene), terms_(all_terms(scene)) {
  loop_.unwatch();  // its laws have no rate limit, and its pushes no force limit
  push_.resize(scene.arms.size());
  states_ = loop_.states;
  for (std::size_t a = 0; a < terms_.size(); ++a) {
    observers_.emplace_back(terms_[a].joint_count());
    terms_[a].update(states_[a]);
    observers_[a].update({terms_[a].momentum(), terms_[a].momentum_drift(), terms_[a].J_V_WK()}, states_[a]);
  }
}

void ForceRig::follow(std::size_t a, const JointVector& q_d, const JointVector& dq_d,
                      const JointVector& ddq_d, const Wrench& F_K_W) {
  constexpr double kRate = 20;  // [rad/s]
  const ArmState& s = states_[a];
  const JointVector ddq = ddq_d + kRate * kRate * (q_d - s.q) + 2 * kRate * (dq_d - s.dq);
  loop_.commands[a].tau_cmd =
      terms_[a].M() * ddq + terms_[a].c() + terms_[a].J_V_WK().transpose() * F_K_W.vector;
}

void ForceRig::hold(std::size_t a, const JointVector& q_d, const Wrench& F_K_W) {
  const JointVector zero = joint_constant(terms_[a].joint_count(), 0);
  follow(a, q_d, zero, zero, F_K_W);
}

void ForceRig::hold_pose(std::size_t a, const Pose& X_WK_d, const Wrench& F_K_W) {
  const Jacobian J = terms_[a].J_V_WK();
  const Vector6 error = pose_error(X_WK_d, terms_[a].X_WK()), V = J * states_[a].dq;
  Vector6 stiffness, damping;
  stiffness << 1500, 1500, 1500, 100, 100, 100;
  damping << 90, 90, 90, 5, 5, 5;
  const Vector6 F = F_K_W.vector + stiffness.cwiseProduct(error) - damping.cwiseProduct(V);
  loop_.commands[a].tau_cmd = J.transpose() * F + terms_[a].c() - 0.3 * states_[a].dq;
}

// MuJoCo takes forces at a body's center of mass.
void ForceRig::apply_pushes() {
  World& world = loop_.backend.world();
  world.forward();
  for (std::size_t a = 0; a < terms_.size(); ++a) {
    const int body = world.arm(a).last_link;
    const Vector3 center = Eigen::Map<const Vector3>(world.data()->xipos + 3 * body);
    const ArmFrames& frames = states_[a].frames;
    const Vector3 p_K = (world.X_WF(a) * frames.X_FE * frames.X_EK).position;
    const Wrench at_center = shifted(push_[a], p_K - center);
    std::copy_n(at_center.vector.data(), 6, world.data()->xfrc_applied + 6 * body);
  }
}

void ForceRig::step() {
  apply_pushes();
  loop_.step();
  for (std::size_t a = 0; a < terms_.size(); ++a) {
    states_[a] = loop_.states[a];
    terms_[a].update(states_[a]);
    observers_[a].update({terms_[a].momentum(), terms_[a].momentum_drift(), terms_[a].J_V_WK()}, states_[a]);
  }
}

void WrenchError::take_worse(const WrenchError& other) {
  const auto worse = [](ErrorFigures& mine, const ErrorFigures& theirs) {
    mine.bias = std::max(mine.bias, theirs.bias);
    mine.rms = std::max(mine.rms, theirs.rms);
    mine.max = std::max(mine.max, theirs.max);
  };
  worse(force, other.force);
  worse(torque, other.torque);
}

std::vector<NamedArm> measured_arms() {
  const SceneArm bare = arm_named("a", {}, false);
  const SceneArm wall = arm_named("a", pose(0.2, -0.3, 0.8, 0, M_PI / 2, 0.4));
  SceneArm loaded = arm_named("a", pose(0.4, -0.2, 0.1, 0.3, -0.2, 2.0));
  loaded.tool = block(0.7, {0.01, -0.02, 0.08});
  loaded.load_declared = loaded.load_present = block(1.0, {-0.02, 0.03, 0.15});
  SceneArm off = loaded;
  off.X_EK = pose(0.05, -0.04, 0.12, 0.4, 0.2, -0.3);
  return {{"bare", bare},
          {"hand, on a wall", wall},
          {"hand, tool, payload, turned", loaded},
          {"the same, K off the end effector", off}};
}

WrenchError error_under_pushes(const SceneArm& arm, const PlantFidelity& plant) {
  ForceRig rig(scene_of({arm}, plant));
  WrenchError worst;
  for (int direction = 0; direction < 12; ++direction) {
    Wrench push;
    push.vector[direction % 6] = (direction < 6 ? 1 : -1) * (direction % 6 < 3 ? 20 : 3);
    rig.push(0, push);
    WrenchErrors errors;
    for (int k = 0; k < kSettle + kWindow; ++k) {
      rig.hold(0, arm.q_start);
      rig.step();
      if (k >= kSettle) errors.add(rig.state(0), reaction(push));
    }
    worst.take_worse(errors.figures());
  }
  return worst;
}

// The payload pulls the arm down, the arm pulls it up.
WrenchError error_with_payload(const SceneArm& with, bool declared, const PlantFidelity& plant) {
  SceneArm arm = with;
  arm.load_present = block(1.2, {0.03, -0.02, 0.14});
  arm.load_declared = declared ? arm.load_present : Load{};
  ForceRig rig(scene_of({arm}, plant));
  WrenchErrors errors;
  for (int k = 0; k < kSettle + kWindow; ++k) {
    rig.hold(0, arm.q_start);
    rig.step();
    if (k < kSettle) continue;
    Wrench at_center;
    if (!declared) at_center.force().z() = arm.load_present.mass * kGravity;
    const Vector3 p_C = rig.terms(0).X_WF() * arm.load_present.p_FC;
    errors.add(rig.state(0), shifted(at_center, p_C - rig.terms(0).X_WK().position));
  }
  return errors.figures();
}

WrenchError error_pressing(const SceneArm& with, const PlantFidelity& plant) {
  SceneArm arm = with;
  arm.tool_shapes = {{.shape = ShapeType::sphere, .size = {0.04, 0, 0}, .X_FS = pose(0, 0, 0.25)}};
  ModelTerms terms = terms_of(arm);
  terms.update(arm.q_start, joint_constant(7, 0));
  const Pose X_WT = terms.X_WF() * pose(0, 0, 0.27);
  SceneObject table;
  table.name = "table";
  table.size = {0.3, 0.3, 0.1};
  table.X_WO = X_WT * pose(0, 0, 0.05);
  table.contact = SurfaceContact{};
  Scene scene = scene_of({arm}, plant);
  scene.objects = {table};
  ForceRig rig(scene);
  Wrench press;
  press.force() = 25 * X_WT.rotation.col(2);
  WrenchErrors errors;
  for (int k = 0; k < 2 * kSettle + kWindow; ++k) {
    rig.hold(0, arm.q_start, press);
    rig.step();
    if (k >= 2 * kSettle) errors.add(rig.state(0), rig.state(0).F_K_W_true);
  }
  return errors.figures();
}

// A box of 1 kg between two pads, held up by friction.
WrenchError error_squeezing(const PlantFidelity& plant) {
  const Pose X_WL = pose(0, -0.21, 1, -M_PI / 2), X_WR = pose(0, 0.21, 1, M_PI / 2);
  const auto padded = [](const std::string& name, const Pose& X_WF) {
    SceneArm arm = arm_named(name, {}, false);
    arm.X_WB = base_for(arm, X_WF);
    arm.X_FE = pose(0, 0, 0.11);
    arm.tool = block(0.3, {0, 0, 0.05});
    arm.tool_shapes = {{.shape = ShapeType::box, .size = {0.06, 0.06, 0.02}, .X_FS = pose(0, 0, 0.1)}};
    return arm;
  };
  Scene scene = scene_of({padded("left", X_WL), padded("right", X_WR)}, plant);
  scene.noslip_iterations = 5;
  SceneObject box;
  box.name = "box";
  box.size.setConstant(0.2);
  box.X_WO.position = {0, 0, 1};
  box.fixed = false;
  box.mass = 1;
  box.contact = SurfaceContact{.damping_ratio = 0.5};
  scene.objects = {box};
  ForceRig rig(scene);
  WrenchErrors errors[2];
  const int body = rig.loop().backend.world().objects()[0].body;
  for (int k = 0; k < 2 * kSettle + kWindow; ++k) {
    rig.loop().backend.world().data()->xfrc_applied[6 * body + 2] =
        k < 500 ? kGravity : 0;  // until it is held
    for (std::size_t a = 0; a < 2; ++a) {
      Wrench squeeze;
      squeeze.force().y() = a == 0 ? 20 : -20;
      rig.hold_pose(a, (a == 0 ? X_WL : X_WR) * pose(0, 0, 0.11), squeeze);
    }
    rig.step();
    if (k < 2 * kSettle) continue;
    for (std::size_t a = 0; a < 2; ++a) errors[a].add(rig.state(a), rig.state(a).F_K_W_true);
  }
  WrenchError worst = errors[0].figures();
  worst.take_worse(errors[1].figures());
  return worst;
}

// Every joint swings by half a radian about the ready posture, q_i = ready_i +- 0.5 sin(2 t), begun smoothly.
WrenchError error_in_motion(const SceneArm& arm, const PlantFidelity& plant) {
  ForceRig rig(scene_of({arm}, plant));
  constexpr double kSwing = 0.5, kRate = 2;
  JointVector swing = joint_constant(7, kSwing);
  for (const Eigen::Index i : {1, 4, 6}) swing[i] = -kSwing;
  WrenchErrors errors;
  JointVector q_d = arm.q_start, dq_d = joint_constant(7, 0), ddq_d = dq_d;
  double phase = 0, fastest = 0;
  constexpr int kPeriods = 5000, kBegin = 1000;
  for (int k = 0; k < kPeriods; ++k) {
    const double rate = kRate * std::min(1.0, 0.001 * k), ramp = k < kBegin ? kRate : 0;
    q_d = arm.q_start + std::sin(phase) * swing;
    dq_d = rate * std::cos(phase) * swing;
    ddq_d = (ramp * std::cos(phase) - rate * rate * std::sin(phase)) * swing;
    phase += 0.001 * rate + 0.5e-6 * ramp;
    rig.follow(0, q_d, dq_d, ddq_d);
    rig.step();
    if (k < kBegin) continue;
    errors.add(rig.state(0), {});
    fastest = std::max(fastest, rig.state(0).dq.cwiseAbs().minCoeff());
  }
  if (fastest < 0.95) throw std::logic_error("the arm did not move as fast as it should");
  return errors.figures();
}

Response response_to_sine(double frequency_hz, const PlantFidelity& plant) {
  const SceneArm arm = arm_named("a");
  ForceRig rig(scene_of({arm}, plant));
  const double omega = 2 * std::numbers::pi * frequency_hz;
  const int settle = 1000,
            whole = static_cast<int>(std::round(std::ceil(frequency_hz) / frequency_hz * 1000)) * 2;
  double in_phase = 0, quadrature = 0;
  for (int k = 0; k < settle + whole; ++k) {
    // The force of a period is that of its middle; the estimate belongs to its end.
    const double t = 0.001 * k;
    Wrench push;
    push.force().x() = 10 * std::sin(omega * (t + 0.0005));
    rig.push(0, push);
    rig.hold(0, arm.q_start);
    rig.step();
    if (k < settle) continue;
    const double seen = -rig.state(0).F_K_W_est.force().x() / 10;
    in_phase += seen * std::sin(omega * (t + 0.001)) * 2 / whole;
    quadrature += seen * std::cos(omega * (t + 0.001)) * 2 / whole;
  }
  return {.gain = std::hypot(in_phase, quadrature), .lag_s = std::atan2(-quadrature, in_phase) / omega};
}

StepResponse response_to_step(const PlantFidelity& plant) {
  const SceneArm arm = arm_named("a");
  ForceRig rig(scene_of({arm}, plant));
  Wrench push;
  StepResponse response;
  double before = 0;
  for (int k = -500; k < 200; ++k) {
    if (k == 0) push.force().x() = 10;
    rig.push(0, push);
    rig.hold(0, arm.q_start);
    rig.step();
    if (k < 0) continue;
    const double seen = -rig.state(0).F_K_W_est.force().x() / 10;
    const auto crossing = [&](double level, double& at) {
      if (at == 0 && seen >= level) at = 0.001 * (k + (level - before) / (seen - before));
    };
    crossing(1 - std::exp(-1), response.to_63_s);
    crossing(0.99, response.to_99_s);
    response.overshoot = std::max(response.overshoot, seen - 1);
    before = seen;
  }
  return response;
}

}  // namespace multipanda::test
