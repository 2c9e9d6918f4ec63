// Features throw nobody: near tables, obstacles, other arms, the arm itself and its limits, with any
// parameters, and whatever is switched or changed, on simulated and on virtual arms.
#include <random>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/series.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::throwing_test {
namespace {

constexpr ContactBounds kBounds;
constexpr double kThick = 0.03, kBelow = 0.0166;  // of the hand's capsules, from the end effector [m]

const Registry& registry() {
  static const Registry all = Registry::with_builtins();
  return all;
}

class Dice {
 public:
  explicit Dice(std::uint32_t seed) : engine_(seed) {}
  double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }
  template <typename T>
  T one_of(std::initializer_list<T> these) {
    return these.begin()[static_cast<std::size_t>(uniform(0, static_cast<double>(these.size()) - 1e-9))];
  }

 private:
  std::mt19937 engine_;
};

ModelTerms terms_at(const SceneArm& arm, const JointVector& q) {
  ModelTerms terms(build_arm_model(arm));
  const ArmConfig config = arm_config(arm);
  terms.set_config(config.frames, config.tool, config.load);
  terms.update(q, joint_constant(7, 0));
  return terms;
}

Pose pose_of(ModelTerms& terms, const CollisionShape& part) {
  return (part.joint < 0 ? terms.model().X_WB() : terms.X_WJ(static_cast<std::size_t>(part.joint))) *
         part.X_JS;
}

// The smallest distance of the arm from itself [m].
double own_distance(ModelTerms& terms) {
  const auto& parts = terms.model().collision_shapes();
  double smallest = 1;
  for (const auto& [a, b] : terms.model().self_pairs()) {
    smallest = std::min(smallest, closest_points(parts[a].shape, pose_of(terms, parts[a]), parts[b].shape,
                                                 pose_of(terms, parts[b]))
                                      .distance);
  }
  return smallest;
}

struct Parameter {
  const char* name;
  double least, most;
};
struct Kind {
  const char* feature;
  std::vector<Parameter> parameters;
};
const Kind kAvoidance{
    "collision_avoidance",
    {{"range_m", 0.005, 0.3}, {"stiffness_n_per_m", 0, 1000}, {"damping_n_s_per_m", 0, 1000}}};
const Kind kLimits{
    "joint_limits",
    {{"range_rad", 0.01, 0.5}, {"stiffness_nm_per_rad", 0, 300}, {"damping_nms_per_rad", 0, 20}}};
const Kind kManipulability{"manipulability",
                           {{"gain_nm", 0, 200}, {"threshold", 0.001, 1}, {"damping_nms_per_rad", 0, 2}}};

struct Case {
  std::string text;  // of its scene
  std::string law;
  bool is_virtual = false;
  bool has_way = true;  // no joint is near its end, which ends a law
};

std::string list_of(const JointVector& q) {
  std::string text;
  for (const double angle : q) text += fmt::format("{}{:.6f}", text.empty() ? "" : ", ", angle);
  return "[" + text + "]";
}
std::string list_of(const Vector3& p) { return fmt::format("[{:.6f}, {:.6f}, {:.6f}]", p.x(), p.y(), p.z()); }

Case draw(std::uint32_t seed, std::uint32_t attempt) {
  Dice dice(seed + 1000 * attempt);
  Case c;
  c.is_virtual = seed % 3 == 2;
  c.law = dice.one_of({"joint_impedance", "cartesian_impedance", "gravity_compensation", "force", "hold"});
  SceneArm arm;
  arm.model = dice.one_of({"fer", "fr3"});
  const auto model = build_arm_model(arm);
  const auto& limits = model->limits();
  JointVector q = model->q_home();
  for (auto& angle : q) angle += dice.uniform(-0.3, 0.3);
  std::string others, objects;
  const Kind* kind = &kAvoidance;
  const double gap = dice.uniform(0.003, 0.045);
  const int place = static_cast<int>(seed / 3 % 6);
  c.has_way = place < 3;
  if (place == 0) {
    q = model->q_home();
    for (auto& angle : q) angle += dice.uniform(-0.1, 0.1);
    const Vector3 p = terms_at(arm, q).X_WE().position - Vector3(0, 0, kBelow + gap + 0.06);
    objects = "  - {name: table, shape: box, size_m: [0.3, 0.4, 0.1], position_m: " + list_of(p) + "}\n";
  } else if (place == 1) {  // a ball beside any link
    ModelTerms terms = terms_at(arm, q);
    std::vector<const CollisionShape*> parts;
    for (const auto& part : model->collision_shapes())
      if (part.scene && part.joint > 1) parts.push_back(&part);
    const auto& part =
        *parts[static_cast<std::size_t>(dice.uniform(0, static_cast<double>(parts.size()) - 1e-9))];
    const ConvexShape ball = ConvexShape::sphere({0, 0, 0}, 0.05);
    const Vector3 way = Vector3(dice.uniform(-1, 1), dice.uniform(-1, 1), dice.uniform(-1, 1)).normalized();
    Pose at{Matrix3::Identity(), pose_of(terms, part).position + 0.4 * way};
    for (int k = 0; k < 5; ++k) {
      const Closest closest = closest_points(part.shape, pose_of(terms, part), ball, at);
      at.position += (closest.distance - gap) * closest.normal;
    }
    objects = "  - {name: ball, shape: sphere, diameter_m: 0.1, position_m: " + list_of(at.position) + "}\n";
  } else if (place == 2) {
    const Vector3 p = terms_at(arm, q).X_WE().position;  // turned by pi about the point between the hands
    others = fmt::format(
        "  - {{name: other, model: {}, start_rad: {}, base: {{position_m: [{:.6f}, {:.6f}, 0], rpy_rad: [0, "
        "0, pi]}}}}\n",
        arm.model, list_of(q), 2 * p.x() + 2 * kThick + gap, 2 * p.y());
  } else if (place == 3) {  // folded onto itself
    for (double distance = 1; !(distance > 0.002 && distance < 0.045);) {
      for (Eigen::Index i = 0; i < 7; ++i)
        q[i] = dice.uniform(limits.q_min[i] + 0.05, limits.q_max[i] - 0.05);
      ModelTerms terms = terms_at(arm, q);
      distance = own_distance(terms);
    }
  } else if (place == 4) {
    kind = &kLimits;
    for (Eigen::Index i = 0; i < 7; ++i) {
      const double inside = dice.uniform(0.02, 0.6);
      if (dice.uniform(0, 1) < 0.4) q[i] = dice.one_of({limits.q_min[i] + inside, limits.q_max[i] - inside});
    }
  } else {
    kind = &kManipulability;
    q[3] = dice.one_of({dice.uniform(-0.6, -0.3), dice.uniform(-2.8, -0.6)});
  }
  const auto value = [&](const Parameter& p) {
    return fmt::format("{:.6g}", p.least + (p.most - p.least) * dice.one_of({0.02, 0.1, 0.3, 1.0}));
  };
  const bool held = c.law == "hold";
  const std::string name = held ? "arm_hold" : "law", feature = kind->feature;
  c.text = fmt::format(
      "seed: {}\nplant: {{fidelity: {}, rotor_inertia_hidden: {}}}\narms:\n"
      "  - {{name: arm, model: {}, start_rad: {}}}\n{}{}controllets:\n"
      "  - {{name: idle, type: gravity_compensation, arms: arm}}\n"
      "  - {{name: {}, type: {}, arms: arm, features: [{}]",
      seed, dice.one_of({"ideal", "realistic"}), dice.one_of({0, 1}), arm.model, list_of(q), others,
      objects.empty() ? "" : "objects:\n" + objects, name, c.law, feature);
  if (dice.uniform(0, 1) < 0.5) {
    c.text += ", parameters: {" + feature + ": {";
    for (const Parameter& p : kind->parameters) c.text += std::string(p.name) + ": " + value(p) + ", ";
    c.text += "}}";
  }
  c.text += "}\nactive: [idle]\ntimeline:\n";
  const auto at = [&](double t, const std::string& what) {
    c.text += fmt::format("  - {{at_s: {}, {}}}\n", t, what);
  };
  at(0.2, held ? "switch: {activate: [], deactivate: [idle]}" : "switch: {activate: [law]}");
  for (const double t : {0.7, 1.2, 1.7}) {
    const int what = static_cast<int>(dice.uniform(0, 5));
    if (what < 3) {
      const Parameter& p = kind->parameters[static_cast<std::size_t>(what)];
      at(t, "parameter: {controllet: " + name + ", name: " + feature + "." + p.name + ", value: " + value(p) +
                "}");
    } else if (what == 3) {
      at(t, "feature: {controllet: " + name + ", name: " + feature + ", on: false}");
      at(t + dice.uniform(0.05, 0.3), "feature: {controllet: " + name + ", name: " + feature + ", on: true}");
    } else {
      at(t, "switch: {activate: [idle]}");
      at(t + 0.2, held ? "switch: {activate: [], deactivate: [idle]}" : "switch: {activate: [law]}");
    }
  }
  return c;
}

struct Outcome {
  // The hand's [m/s]: along what the features draw it with, or any, where nothing else drives it.
  double speed = -1;
  double share = 0;              // of the joints' greatest speeds, as above
  double force = 0, moment = 0;  // with which features draw the hand [N], [N m]
  double step = 0;               // of their torque, of a joint, from cycle to cycle [N m]
  std::vector<std::string> faults;
};

Outcome run(const Case& c) {
  const Scene scene = parse_scene(c.text, "throwing.yaml", registry());
  ModelTerms terms = terms_at(scene.arms[0], scene.arms[0].q_start);
  Outcome outcome{.speed = 0};
  std::uint64_t owner = 0;
  JointVector before = joint_constant(7, 0);
  const bool alone = c.law == "gravity_compensation";
  SessionOptions options{.paced = false, .duration_s = 2.3};
  options.backend.kind = c.is_virtual ? BackendKind::virtual_arms : BackendKind::mujoco;
  options.observer = [&](const CycleRecord& record) {
    const ArmSample& arm = record.arms[0];
    const JointVector q = Eigen::Map<const Eigen::VectorXd>(arm.q.data(), 7);
    const JointVector dq = Eigen::Map<const Eigen::VectorXd>(arm.dq.data(), 7);
    const JointVector tau = Eigen::Map<const Eigen::VectorXd>(arm.tau_feature.data(), 7);
    terms.update(q, dq);
    const Vector3 v = terms.V_WE().linear();
    const TaskSpace& task = terms.task();
    const auto held = [&](const JointVector& torque) -> Vector6 {
      return task.press() * Vector6(task.J_bar.transpose() * torque);
    };
    const Vector6 drawn = held(tau),
                  law = held(Eigen::Map<const Eigen::VectorXd>(arm.tau_controllet.data(), 7));
    // What the law presses against it does not reach anybody.
    const auto net = [&](const Vector3& pull, const Vector3& pressed) {
      return pull.norm() + std::min(0.0, pull.dot(pressed) / std::max(1e-9, pull.norm()));
    };
    const double force = drawn.head<3>().norm();
    if (tau.dot(dq) >= 0) {  // otherwise it brakes
      outcome.force = std::max(outcome.force, net(drawn.head<3>(), law.head<3>()));
      outcome.moment = std::max(outcome.moment, net(drawn.tail<3>(), law.tail<3>()));
      if (force > 0.5) outcome.speed = std::max(outcome.speed, v.dot(Vector3(drawn.head<3>())) / force);
    }
    if (alone) outcome.speed = std::max(outcome.speed, v.norm());
    // A spring of the law may turn a light wrist back faster.
    const JointVector share = dq.cwiseQuotient(scene.arms[0].safety.joints.dq_max);
    if (alone) outcome.share = std::max(outcome.share, share.lpNorm<Eigen::Infinity>());
    if (arm.owner == owner) outcome.step = std::max(outcome.step, (tau - before).lpNorm<Eigen::Infinity>());
    before = tau;
    owner = arm.owner;
  };
  Session session(scene, registry(), std::move(options));
  session.start();
  outcome.faults = session.finish().faults();
  return outcome;
}

// Switching on 17 mm above a table gave 0.53 m/s, a range of 0.3 m 1.4 m/s or a reflex.
TEST(Throwing, NoFeatureDrivesAHandFasterThanItsBound) {
  test::Series series;
  for (std::uint32_t seed = 0; seed < 1000; ++seed) {
    // In 274 a wrist's spring turns a hand that is pushed: it went along its pull with 0.261 m/s.
    if (!series.takes(seed < 100 || seed == 274)) continue;
    Case c;
    Outcome outcome;
    for (std::uint32_t attempt = 0; outcome.speed < 0; ++attempt) {
      try {
        c = draw(seed, attempt);
        outcome = run(c);
      } catch (const std::invalid_argument&) {  // starts in contact
        if (attempt > 100) throw;
      }
    }
    series.record("speed_m_per_s", outcome.speed);
    series.record("joint_share", outcome.share);
    series.record("force_n", outcome.force);
    series.record("moment_nm", outcome.moment);
    series.record("step_nm", outcome.step);
    EXPECT_LT(outcome.speed, kBounds.hand_speed) << c.text;
    EXPECT_LT(outcome.share, 0.8) << c.text;
    EXPECT_LT(outcome.force, 1.01 * kBounds.spring_force) << c.text;
    EXPECT_LT(outcome.moment, 1.01 * kBounds.spring_moment) << c.text;
    if (c.has_way) {
      EXPECT_EQ(outcome.faults, std::vector<std::string>()) << c.text;
    }
  }
  if (series.whole()) {
    std::printf("%zu cases: hand %.3f m/s, joints %.2f of their speed, %.1f N, %.2f N m, steps of %.2f N m\n",
                series.size(), series.largest("speed_m_per_s"), series.largest("joint_share"),
                series.largest("force_n"), series.largest("moment_nm"), series.largest("step_nm"));
    EXPECT_GT(series.largest("speed_m_per_s"), 0.5 * kBounds.hand_speed) << "none was pushed";
  }
}

// The hold 17 mm above a table, with the widest range: pushed away until it is stopped, wherever that is, or
// never where it starts stopped. Before, a stop let it go on by up to 0.32 m.
TEST(Throwing, AStoppedArmStaysWhereItWasStopped) {
  SceneArm arm;
  arm.model = "fer";
  const double z = terms_at(arm, build_arm_model(arm)->q_home()).X_WE().position.z() - kBelow - 0.017 - 0.05;
  for (const double stopped_s : {0.3, 0.5, 2.0}) {
    for (const bool from_a_law : {false, true}) {
      const std::string text = fmt::format(
          "plant: {{fidelity: realistic}}\narms:\n  - {{name: arm, model: fer}}\nobjects:\n"
          "  - {{name: table, shape: box, size_m: [0.3, 0.4, 0.1], position_m: [0.4, 0, {:.6f}]}}\n"
          "controllets:\n"
          "  - {{name: arm_hold, type: hold, arms: arm, features: [collision_avoidance], parameters: "
          "{{collision_avoidance: {{range_m: 0.3}}}}}}\n"
          "  - {{name: law, type: cartesian_impedance, arms: arm}}\n"
          "active: [{}]\ntimeline:\n  - {{at_s: {}, stop: [arm]}}\n",
          z, from_a_law ? "law" : "", stopped_s);
      const Scene scene = parse_scene(text, "stopped.yaml", registry());
      ModelTerms terms = terms_at(scene.arms[0], scene.arms[0].q_start);
      const bool at_rest = from_a_law || stopped_s > 1;
      Vector3 start = Vector3::Zero(), at = start;
      double moved = 0;
      SessionOptions options{.paced = false, .duration_s = stopped_s + 3};
      options.observer = [&](const CycleRecord& record) {
        const JointVector q = Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), 7);
        terms.update(q, joint_constant(7, 0));
        const Vector3 p = terms.X_WE().position;
        if (start.isZero(0)) start = p;
        // Where it was when it was stopped or, if it was on its way, had come to rest.
        if (at.isZero(0) && record.t.seconds() > stopped_s + (at_rest ? 0 : 0.3)) at = p;
        if (!at.isZero(0)) moved = std::max(moved, (p - at).norm());
      };
      Session session(scene, registry(), std::move(options));
      session.start();
      session.finish();
      std::printf("stopped at %.1f s%s: %.1f mm before, %.2f mm after\n", stopped_s,
                  from_a_law ? " from a law" : "", 1e3 * (at - start).norm(), 1e3 * moved);
      EXPECT_LT(moved, 0.005) << stopped_s << " " << from_a_law;
      if (!from_a_law) {
        EXPECT_GT((at - start).norm(), 0.01) << "it was pushed";
      }
    }
  }
}

// A feature that has pushed an arm away lets it go: by its range, by its stiffness or gain, switched off, or
// off and on again while its range falls. Before, the spring of the law threw it at up to 0.6 m/s, or its
// wrist too fast for it to go on; bent far by manipulability, it snapped back at 0.28 m/s.
TEST(Throwing, WhatAFeatureLetsGoComesBackSlowly) {
  struct Release {
    const char *feature, *parameters, *start, *change;
  };
  for (const Release& r : {
           Release{"collision_avoidance", "range_m: 0.3", "ready", "range_m"},
           Release{"collision_avoidance", "range_m: 0.3", "ready", "stiffness_n_per_m"},
           Release{"collision_avoidance", "range_m: 0.3", "ready", "off"},
           Release{"collision_avoidance", "range_m: 0.3", "ready", "off and on"},
           Release{"joint_limits", "range_rad: 0.5, stiffness_nm_per_rad: 300",
                   "[2.6, -0.785, 0, -2.9, 0, 1.57, 0.785]", "stiffness_nm_per_rad"},
           Release{"joint_limits", "range_rad: 0.5, stiffness_nm_per_rad: 300",
                   "[2.6, -0.785, 0, -2.9, 0, 1.57, 0.785]", "off"},
           Release{"manipulability", "gain_nm: 200, threshold: 1", "[0, -0.785, 0, -0.8, 0, 1.57, 0.785]",
                   "gain_nm"},
           Release{"manipulability", "gain_nm: 200, threshold: 1", "[0, -0.785, 0, -0.8, 0, 1.57, 0.785]",
                   "off"},
       }) {
    for (const std::string law : {"cartesian_impedance", "joint_impedance", "hold"}) {
      if (law == "hold" && std::string(r.feature) == "manipulability") continue;  // does not push it
      SceneArm arm;
      arm.model = "fer";
      const double z =
          terms_at(arm, build_arm_model(arm)->q_home()).X_WE().position.z() - kBelow - 0.02 - 0.05;
      const std::string name = law == "hold" ? "arm_hold" : "law", change = r.change, feature = r.feature;
      const auto at = [](double t, const std::string& what) {
        return fmt::format("  - {{at_s: {}, {}}}\n", t, what);
      };
      const auto set = [&](const std::string& parameter, double value) {
        return fmt::format("parameter: {{controllet: {}, name: {}.{}, value: {}}}", name, feature, parameter,
                           value);
      };
      const auto turn = [&](bool on) {
        return fmt::format("feature: {{controllet: {}, name: {}, on: {}}}", name, feature, on);
      };
      const std::string events =
          change == "off" ? at(3, turn(false))
          : change == "off and on"
              ? at(3, set("range_m", 0.005)) + at(3.21, turn(false)) + at(3.212, turn(true))
              : at(3, set(change, change == "range_m" ? 0.005 : 0));
      const std::string text = fmt::format(
          "plant: {{fidelity: realistic}}\narms:\n  - {{name: arm, model: fer, start_rad: {}}}\n{}"
          "controllets:\n  - {{name: {}, type: {}, arms: arm, features: [{}], parameters: {{{}: {{{}}}}}}}\n"
          "active: [{}]\ntimeline:\n{}",
          r.start,
          feature == "collision_avoidance"
              ? fmt::format(
                    "objects:\n  - {{name: table, shape: box, size_m: [0.3, 0.4, 0.1], position_m: [0.4, "
                    "0, {:.6f}]}}\n",
                    z)
              : "",
          name, law, feature, feature, r.parameters, law == "hold" ? "" : "law", events);
      const Scene scene = parse_scene(text, "release.yaml", registry());
      ModelTerms terms = terms_at(scene.arms[0], scene.arms[0].q_start);
      double fastest = 0;
      Vector3 pushed = Vector3::Zero(), end = pushed;
      SessionOptions options{.paced = false, .duration_s = 9};
      options.observer = [&](const CycleRecord& record) {
        if (record.t.seconds() < 2.9) return;
        terms.update(Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), 7),
                     Eigen::Map<const Eigen::VectorXd>(record.arms[0].dq.data(), 7));
        end = terms.X_WE().position;
        if (pushed.isZero(0)) pushed = end;
        fastest = std::max(fastest, terms.V_WE().linear().norm());
      };
      Session session(scene, registry(), std::move(options));
      session.start();
      const std::vector<std::string> faults = session.finish().faults();
      std::printf("%s, %s, %s: %.3f m/s over %.3f m\n", feature.c_str(), change.c_str(), law.c_str(), fastest,
                  (end - pushed).norm());
      EXPECT_EQ(faults, std::vector<std::string>()) << text;
      EXPECT_LT(fastest, kBounds.hand_speed) << text;
      EXPECT_GT((end - pushed).norm(), 0.02) << text;
    }
  }
}

// What changes again and again before an arm has settled, behind 3 ms of delay; and what is switched off and
// on, without delay and behind it. With 1,500 N/m 10 of 12 of the latter with cartesian_impedance lost their
// arm, at up to 0.48 m/s. They still exceed the bound of the hand: docs/promises.md.
TEST(Throwing, WhatChangesAllTheTimeLosesNoArm) {
  constexpr std::uint32_t kChanges = 240, kSwitches = 3 * 2 * 6 * 2 * 2;
  constexpr std::array kPeriods{50, 100, 150, 200, 300, 500};  // [ms]
  test::Series series;
  for (std::uint32_t seed = 0; seed < kChanges + kSwitches; ++seed) {
    const bool off_and_on = seed >= kChanges;
    const std::uint32_t choice = seed - kChanges;  // of law, feature, period, plant and delay of switches
    if (!series.takes(off_and_on ? choice % 6 == 0 : seed % 40 == 6)) continue;
    Dice dice(seed);
    const std::string law = std::array{"cartesian_impedance", "joint_impedance", "hold"}[seed % 3];
    const std::string name = law == "hold" ? "arm_hold" : "law";
    const bool limits = off_and_on ? choice / 3 % 2 == 1 : seed / 3 % 4 == 3;
    const std::string feature = limits ? "joint_limits" : "collision_avoidance";
    const Kind& kind = limits ? kLimits : kAvoidance;
    SceneArm arm;
    arm.model = "fer";
    const double z = terms_at(arm, build_arm_model(arm)->q_home()).X_WE().position.z() - kBelow - 0.02 - 0.05;
    const int every = off_and_on ? kPeriods[choice / 6 % 6] : dice.one_of({50, 100, 150, 200, 300, 500});
    const bool real = off_and_on ? choice / 36 % 2 == 1 : dice.one_of({false, true});
    const double delay_s = off_and_on && choice / 72 == 0 ? 0 : 0.003;
    const int which = dice.one_of({0, 1, 0, 1, 2, 3});
    const double least0 = dice.one_of({0.0, 0.1, 0.3}), most0 = dice.one_of({1.0, 1.0, 0.5});
    std::string events;
    for (int ms = 500; ms < 6000; ms += every) {
      if (off_and_on) {
        events += fmt::format("  - {{at_s: {:.3f}, feature: {{controllet: {}, name: {}, on: {}}}}}\n",
                              1e-3 * ms, name, feature, (ms - 500) / every % 2 == 1);
        continue;
      }
      for (int k = 0; k < 2; ++k) {
        if (which != k && which < 2) continue;
        if (which == 3 && dice.uniform(0, 1) < 0.5) continue;
        const Parameter& p = kind.parameters[static_cast<std::size_t>(k)];
        const double share = which == 3 ? dice.uniform(0, 1) : (ms - 500) / every % 2 == 0 ? most0 : least0;
        events +=
            fmt::format("  - {{at_s: {:.3f}, parameter: {{controllet: {}, name: {}.{}, value: {:.6g}}}}}\n",
                        1e-3 * ms, name, feature, p.name, p.least + share * (p.most - p.least));
      }
    }
    const std::string text = fmt::format(
        "plant: {{fidelity: {}, command_delay_s: {}}}\narms:\n  - {{name: arm, model: fer, start_rad: "
        "{}}}\n{}"
        "controllets:\n  - {{name: {}, type: {}, arms: arm, features: [{}], parameters: {{{}: {}}}}}\n"
        "active: [{}]\ntimeline:\n{}",
        real ? "realistic" : "ideal", delay_s, limits ? "[2.6, -0.785, 0, -2.9, 0, 1.57, 0.785]" : "ready",
        limits ? ""
               : fmt::format("objects:\n  - {{name: table, shape: box, size_m: [0.3, 0.4, "
                             "0.1], position_m: [0.4, 0, {:.6f}]}}\n",
                             z),
        name, law, feature, feature,
        limits ? "{range_rad: 0.5, stiffness_nm_per_rad: 300}" : "{range_m: 0.3, stiffness_n_per_m: 1000}",
        law == "hold" ? "" : "law", events);
    const Scene scene = parse_scene(text, "changes.yaml", registry());
    ModelTerms terms = terms_at(scene.arms[0], scene.arms[0].q_start);
    double fastest = 0;
    SessionOptions options{.paced = false, .duration_s = 6.5};
    options.observer = [&](const CycleRecord& record) {
      terms.update(Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), 7),
                   Eigen::Map<const Eigen::VectorXd>(record.arms[0].dq.data(), 7));
      fastest = std::max(fastest, terms.V_WE().linear().norm());
    };
    Session session(scene, registry(), std::move(options));
    session.start();
    const std::vector<std::string> faults = session.finish().faults();
    series.record("speed_m_per_s", fastest);
    EXPECT_EQ(faults, std::vector<std::string>()) << seed;
    EXPECT_LT(fastest, !off_and_on ? kBounds.hand_speed : delay_s == 0 ? 0.30 : 0.34) << seed;
  }
}

}  // namespace
}  // namespace multipanda::throwing_test
