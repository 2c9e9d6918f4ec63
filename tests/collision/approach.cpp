#include "tests/collision/approach.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <span>
#include <stdexcept>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/geometry/shape.hpp"
#include "core/modes/registry.hpp"
#include "scene/build.hpp"

namespace multipanda::approach {
namespace {

constexpr double kRange = 0.05;  // [m]
constexpr double kSpeed = 0.5;   // [m/s]

const Registry& registry() {
  static const Registry builtins = Registry::with_builtins();
  return builtins;
}

class Dice {
 public:
  Dice(std::uint32_t seed, std::uint32_t attempt) : sequence_{seed, attempt}, engine_(sequence_) {}
  double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }

 private:
  std::seed_seq sequence_;
  std::mt19937 engine_;
};

SceneArm franka(const std::string& name, const Pose& X_WB, const JointVector& q) {
  SceneArm arm;
  arm.name = name;
  arm.X_WB = X_WB;
  arm.q_start = q;
  arm.safety = SafetyLimits::of(*build_arm_model(arm));
  return arm;
}

JointVector near_ready(Dice& dice, double spread) {
  JointVector q(7);
  q << 0, -M_PI / 4, 0, -3 * M_PI / 4, 0, M_PI / 2, M_PI / 4;
  for (auto& angle : q) angle += dice.uniform(-spread, spread);
  return q;
}

Pose end_effector(const SceneArm& arm) {
  ModelTerms terms(build_arm_model(arm));
  const ArmConfig config = arm_config(arm);
  terms.set_config(config.frames, config.tool, config.load);
  terms.update(arm.q_start, joint_constant(7, 0));
  return terms.X_WE();
}

InstanceConfig controllet(const std::string& name, const std::string& type, std::vector<ArmIndex> arms,
                          const std::vector<std::string>& inputs) {
  InstanceConfig config{.name = name, .type = type, .arms = std::move(arms)};
  config.features = {"collision_avoidance"};
  // The inputs' limits must not slow the approach.
  for (const auto& input : inputs) config.inputs.push_back({.name = input, .timeout_s = 1, .max_speed = 2});
  return config;
}

SceneObject box(const std::string& name, const Vector3& size, const Pose& X_WO) {
  SceneObject object;
  object.name = name;
  object.shape = ShapeType::box;
  object.size = size;
  object.X_WO = X_WO;
  return object;
}

// The smallest distance of all checked pairs, from the shapes.
class Ruler {
 public:
  Ruler(const std::vector<std::shared_ptr<const ArmModel>>& models, std::vector<Obstacle> obstacles)
      : obstacles_(std::move(obstacles)) {
    for (const auto& model : models) terms_.emplace_back(model);
  }
  double smallest(std::span<const JointVector> q) {
    double smallest = 1e9;
    for (std::size_t i = 0; i < terms_.size(); ++i) terms_[i].update(q[i], joint_constant(7, 0));
    for (std::size_t i = 0; i < terms_.size(); ++i) {
      const auto& parts = terms_[i].model().collision_shapes();
      const auto take = [&](const CollisionShape& a, const Pose& X_WA, const ConvexShape& b,
                            const Pose& X_WB) {
        smallest = std::min(smallest, closest_points(a.shape, X_WA, b, X_WB).distance);
      };
      for (const auto& [a, b] : terms_[i].model().self_pairs()) {
        take(parts[a], pose(i, parts[a]), parts[b].shape, pose(i, parts[b]));
      }
      for (const auto& part : parts) {
        for (const auto& obstacle : obstacles_) {
          if (part.scene) take(part, pose(i, part), obstacle.shape, obstacle.X_WO);
        }
        for (std::size_t k = i + 1; k < terms_.size(); ++k) {
          for (const auto& other : terms_[k].model().collision_shapes()) {
            take(part, pose(i, part), other.shape, pose(k, other));
          }
        }
      }
    }
    return smallest;
  }

 private:
  Pose pose(std::size_t arm, const CollisionShape& part) {
    const Pose X_WJ =
        part.joint < 0 ? terms_[arm].model().X_WB() : terms_[arm].X_WJ(static_cast<std::size_t>(part.joint));
    return X_WJ * part.X_JS;
  }
  std::vector<Obstacle> obstacles_;
  std::vector<ModelTerms> terms_;
};

Pose base(double x, double y, double yaw) { return {rotation_from_rpy({0, 0, yaw}), {x, y, 0}}; }

// The hand moves down towards a tilted table.
void table(Dice& dice, Approach& approach) {
  const double yaw = dice.uniform(-3, 3);
  approach.scene.arms = {franka("arm", base(0, 0, yaw), near_ready(dice, 0.2))};
  const Vector3 p = end_effector(approach.scene.arms[0]).position;
  const Pose tilt{rotation_from_rpy({dice.uniform(-0.3, 0.3), dice.uniform(-0.3, 0.3), dice.uniform(-3, 3)}),
                  {}};
  const Vector3 up = tilt.rotation.col(2);
  const double gap = dice.uniform(0.2, 0.3);
  approach.scene.objects = {box("table", {0.3, 0.3, 0.1}, {tilt.rotation, p - (gap + 0.05) * up})};
  const double aside = dice.uniform(-0.3, 0.3);
  const Vector3 slide = tilt.rotation * Vector3(dice.uniform(-0.3, 0.3), aside, 0);
  const Vector3 way = (slide - up).normalized();
  const double rate = kSpeed / -way.dot(up);
  approach.paths = {{.way = way, .length = (gap + dice.uniform(0.02, 0.08)) * rate / kSpeed, .rate = rate}};
  approach.scene.controllets = {controllet("law", "cartesian_impedance", {0}, {"pose"})};
}

// Joint 1 swings the arm into a round post.
void post(Dice& dice, Approach& approach) {
  approach.scene.arms = {franka("arm", base(0.1, -0.2, dice.uniform(-3, 3)), near_ready(dice, 0.2))};
  const SceneArm& arm = approach.scene.arms[0];
  const Vector3 p_B = arm.X_WB.inverse() * end_effector(arm).position;
  const double reach = std::hypot(p_B.x(), p_B.y()), side = dice.uniform(-1, 1) > 0 ? 1 : -1;
  const double turn = side * dice.uniform(0.9, 1.2);
  const double angle = std::atan2(p_B.y(), p_B.x()) + turn;
  const double radius = dice.uniform(0.03, 0.06), out = reach + dice.uniform(-0.05, 0.05);
  SceneObject object =
      box("post", {2 * radius, 0, 1.2},
          arm.X_WB * Pose{Matrix3::Identity(), {out * std::cos(angle), out * std::sin(angle), 0.6}});
  object.shape = ShapeType::cylinder;
  approach.scene.objects = {object};
  JointVector way = joint_constant(7, 0);
  way[0] = side;
  approach.paths = {
      {.joint_way = way, .length = std::abs(turn) - dice.uniform(0.12, 0.2), .rate = kSpeed / reach}};
  approach.scene.controllets = {controllet("law", "joint_impedance", {0}, {"joints"})};
}

// The arm folds in joint space until it would collide with itself.
void self(Dice& dice, Approach& approach) {
  const Pose X_WB = base(0, 0, dice.uniform(-3, 3));
  const SceneArm upright = franka("arm", X_WB, near_ready(dice, 0));
  const auto model = build_arm_model(upright);
  const ArmLimits& limits = model->limits();
  Ruler ruler({model}, {});
  const auto distance = [&](const JointVector& q) { return ruler.smallest(std::array{q}); };
  for (int attempt = 0; attempt < 10000; ++attempt) {
    JointVector inside = upright.q_start, start = near_ready(dice, 0.2);
    for (Eigen::Index i = 0; i < 7; ++i) {
      const double margin = 0.1;
      inside[i] = dice.uniform(limits.q_min[i] + margin, limits.q_max[i] - margin);
    }
    if (distance(inside) > -0.03) continue;
    // The first points of the path where the gap equals the range, and where the arm collides with itself.
    const auto at = [&](double s) { return JointVector(start + s * (inside - start)); };
    constexpr double kStep = 1e-3;
    double near = 0, in = 0;
    while (near < 1 && distance(at(near)) > kRange) near += kStep;
    in = near;
    while (in < 1 && distance(at(in)) > -0.02) in += kStep;
    if (near < 0.1 || in >= 1) continue;
    const double slope = (distance(at(near - kStep)) - distance(at(near))) / kStep;
    if (slope < 0.1) continue;
    // Starts at most half a second before.
    const double rate = kSpeed / slope, from = std::max(0.0, near - 0.4 * rate);
    if ((rate * (inside - start)).cwiseQuotient(limits.dq_max).cwiseAbs().maxCoeff() > 0.7) continue;
    approach.scene.arms = {franka("arm", X_WB, at(from))};
    approach.paths = {{.joint_way = inside - start, .length = in - from, .rate = rate}};
    approach.scene.controllets = {controllet("law", "joint_impedance", {0}, {"joints"})};
    return;
  }
  throw std::logic_error("found no motion in which the arm collides with itself");
}

// Two hands approach each other, each at half the speed, or one of them moves.
void meeting(Dice& dice, Approach& approach) {
  const bool facing = dice.uniform(-1, 1) > 0;
  const Pose left = facing ? base(-0.45, dice.uniform(-0.05, 0.05), 0) : base(0, 0.26, 0);
  const Pose right = facing ? base(0.45, dice.uniform(-0.05, 0.05), M_PI) : base(0, -0.26, 0);
  approach.scene.arms = {franka("left", left, near_ready(dice, 0.15)),
                         franka("right", right, near_ready(dice, 0.15))};
  const Vector3 p = end_effector(approach.scene.arms[0]).position;
  const Vector3 q = end_effector(approach.scene.arms[1]).position;
  const Vector3 way = (q - p).normalized();
  const double share = std::array{0.0, 0.5, 0.5, 1.0}[static_cast<std::size_t>(dice.uniform(0, 3.999))];
  // The paths end slightly before or behind each other, because hands are wide.
  const double length = (q - p).norm() - dice.uniform(-0.05, 0.05);
  approach.paths = {{.way = way, .length = share * length, .rate = share * kSpeed},
                    {.way = -way, .length = (1 - share) * length, .rate = (1 - share) * kSpeed}};
}

// True if an arm touches the scene, another arm or another part of itself, except finger against finger.
bool touches(const MujocoBackend& backend) {
  const mjModel* m = backend.world().model();
  const mjData* d = backend.world().data();
  const auto name = [&](int geom) {
    const char* text = mj_id2name(m, mjOBJ_BODY, m->geom_bodyid[geom]);
    return std::string(text == nullptr ? "" : text);
  };
  for (int i = 0; i < d->ncon; ++i) {
    if (d->contact[i].dist > 0) continue;
    const std::string a = name(d->contact[i].geom[0]), b = name(d->contact[i].geom[1]);
    const auto arm_of = [](const std::string& body) { return body.substr(0, body.find('/') + 1); };
    const bool fingers = a.find("finger") != a.npos && b.find("finger") != b.npos;
    if (!(fingers && arm_of(a) == arm_of(b))) return true;
  }
  return false;
}

// Distance covered at time t; the rate ramps up and down within a tenth of a second.
double covered(double t, double length, double rate) {
  constexpr double kRamp = 0.1;
  if (rate <= 0) return 0;
  const double whole = length / rate + kRamp;
  t = std::clamp(t, 0.0, whole);
  const auto ramp = [&](double s) {
    return s < kRamp ? 0.5 * rate * s * s / kRamp : rate * (s - 0.5 * kRamp);
  };
  return t < whole - kRamp ? ramp(t) : length - ramp(whole - t);
}

}  // namespace

std::string to_string(Kind kind) {
  return std::array{"table", "post", "self", "apart", "together"}[static_cast<std::size_t>(kind)];
}

Approach draw(std::uint32_t seed, std::uint32_t attempt) {
  Dice dice(seed, attempt);
  Approach approach;
  approach.scene.contact_bounds = ContactBounds::lifted();
  approach.kind = static_cast<Kind>(seed % kKinds);
  approach.speed = kSpeed;
  switch (approach.kind) {
    case Kind::table:
      table(dice, approach);
      break;
    case Kind::post:
      post(dice, approach);
      break;
    case Kind::self:
      self(dice, approach);
      break;
    case Kind::apart:
      meeting(dice, approach);
      approach.scene.controllets = {controllet("law", "cartesian_impedance", {0}, {"pose"}),
                                    controllet("other", "cartesian_impedance", {1}, {"pose"})};
      break;
    case Kind::together:
      meeting(dice, approach);
      approach.scene.controllets = {
          controllet("law", "dual_cartesian_impedance", {0, 1}, {"first_pose", "second_pose"})};
      approach.scene.controllets[0].parameters.push_back({"goals", {1}});
      break;
  }
  for (const auto& law : approach.scene.controllets) approach.scene.active.push_back(law.name);
  for (const auto& path : approach.paths) {
    if (path.rate > 0) approach.duration_s = std::max(approach.duration_s, path.length / path.rate + 0.6);
  }
  return approach;
}

Approach draw_touching(std::uint32_t seed, Outcome& without) {
  for (std::uint32_t attempt = 0; attempt < 20; ++attempt) {
    try {
      Approach approach = draw(seed, attempt);
      without = run(approach, false);
      if (without.touched && without.taken_out.empty() && without.start > kRange + 0.02 &&
          std::abs(without.speed - kSpeed) < 0.1) {
        return approach;
      }
    } catch (const std::invalid_argument&) {  // starts in collision
    }
  }
  throw std::logic_error("no approach of seed " + std::to_string(seed) + " touches anything");
}

Outcome run(const Approach& approach, bool avoid) {
  Scene scene = approach.scene;
  if (!avoid) {
    for (auto& law : scene.controllets) law.features.clear();
  }
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  // Without this the arms' own checks would stop them before they touch.
  for (ArmIndex i = 0; i < backend.arm_count(); ++i) backend.arm(i).watch(false);
  CycleConfig config = build_cycle_config(scene);
  std::vector<std::shared_ptr<const ArmModel>> models;
  for (const auto& arm : config.arms) models.push_back(arm.model);
  Ruler ruler(models, config.obstacles);
  std::vector<JointVector> q(models.size(), joint_constant(7, 0));
  JointVector dq = q[0];
  ControlCycle cycle(config, registry(), backend);
  MultimodeController& modes = cycle.modes();
  modes.activate_at_start(start_set(scene, modes));

  // The input that moves each arm.
  std::vector<Reference*> inputs;
  for (const auto& law : scene.controllets) {
    for (auto& input : modes.instance(modes.find(law.name)).inputs()) {
      const Quantity quantity = input.spec().quantity;
      if (quantity != Quantity::pose && quantity != Quantity::joints) continue;
      if (input.spec().name != "common_pose") inputs.push_back(&input);
    }
  }
  Outcome outcome;
  backend.start();
  double before = 0;
  std::vector<Pose> start;
  for (const auto& arm : scene.arms) start.push_back(end_effector(arm));
  const auto steps = static_cast<std::size_t>(approach.duration_s * 1000);
  for (std::size_t k = 0; k < steps; ++k) {
    const double t = 1e-3 * static_cast<double>(k);
    for (std::size_t i = 0; i < approach.paths.size(); ++i) {
      const auto& path = approach.paths[i];
      const double s = covered(t, path.length, path.rate);
      if (path.joint_way.size() > 0) {
        const JointVector q_d = scene.arms[i].q_start + s * path.joint_way;
        Target target;
        target.delivery = Delivery::stream;
        target.size = static_cast<std::uint8_t>(q_d.size());
        std::copy(q_d.begin(), q_d.end(), target.values.begin());
        inputs[i]->post(target);
      } else {
        Pose X = start[i];
        X.position += s * path.way;
        inputs[i]->post(pose_target(X, 0, Delivery::stream));
      }
    }
    cycle.step(backend.wait());
    for (std::size_t i = 0; i < q.size(); ++i) backend.world().joints(i, q[i], dq);
    const double d = ruler.smallest(q);
    if (k == 0) outcome.start = d;
    if (before >= kRange && d < kRange && outcome.speed == 0) outcome.speed = (before - d) * 1e3;
    before = d;
    outcome.clearance = std::min(outcome.clearance, d);
    outcome.touched = outcome.touched || touches(backend);
    for (std::size_t i = 0; i < scene.arms.size(); ++i) {
      const JointVector requested = cycle.data().tau_controllet[i] + cycle.data().tau_feature[i];
      outcome.torque_share =
          std::max(outcome.torque_share,
                   requested.cwiseQuotient(scene.arms[i].safety.joints.tau_max).cwiseAbs().maxCoeff());
    }
  }
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(Intervention::count_); ++k) {
      const auto rule = static_cast<Intervention>(k);
      const std::uint64_t counted = cycle.safety().counted(i, rule);
      if (rule == Intervention::torque_clamped) {
        outcome.torque_cut += counted;
      } else if (rule == Intervention::torque_rate_clamped) {
        outcome.rate_cut += counted;
      } else if (counted > 0) {
        outcome.taken_out = to_string(rule);
      }
    }
  }
  return outcome;
}

}  // namespace multipanda::approach
