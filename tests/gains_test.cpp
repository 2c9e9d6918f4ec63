// Every gain at its bounds, and every default: each law leads every arm through ordinary goals, and no rule
// takes it out.
#include <random>

#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/modes/registry.hpp"
#include "core/testing/series.hpp"
#include "runtime/virtual_backend.hpp"
#include "scene/build.hpp"

namespace multipanda::gains_test {
namespace {

class Dice {
 public:
  explicit Dice(std::uint32_t seed) : engine_(seed + 400) {}
  double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }
  template <typename T>
  T one_of(std::initializer_list<T> these) {
    return these.begin()[static_cast<std::size_t>(uniform(0, static_cast<double>(these.size()) - 1e-9))];
  }

 private:
  std::mt19937 engine_;
};

bool is_gain(const ParameterSpec& spec) {
  return spec.name.find("stiffness") != spec.name.npos || spec.name.find("damping") != spec.name.npos ||
         spec.name == "projector" || spec.name == "acceleration_feedforward";
}

struct Case {
  Scene scene;
  std::string name;
  bool two = false;
};

SceneArm arm_of(std::size_t i, const std::string& model, bool hand, double hidden) {
  SceneArm arm;
  arm.name = i == 0 ? "left" : "right";
  arm.model = model;
  arm.hand = hand;
  arm.rotor_hidden = hidden;
  arm.X_WB.position.y() = i == 0 ? 0.3 : -0.3;
  arm.q_start.resize(7);
  arm.q_start << 0, -M_PI / 4, 0, -3 * M_PI / 4, 0, M_PI / 2, M_PI / 4;
  arm.safety = SafetyLimits::of(*build_arm_model(arm));
  return arm;
}

Case draw(std::uint32_t seed) {
  Dice dice(seed);
  Case c;
  c.scene.plant = seed / 32 % 2 == 0 ? PlantFidelity::realistic() : PlantFidelity::ideal();
  const std::string type = std::array{"joint_impedance",
                                      "cartesian_impedance",
                                      "dual_cartesian_impedance",
                                      "hybrid_force",
                                      "coupled_dual_cartesian_impedance",
                                      "ufic",
                                      "coupled_ufic",
                                      "force"}[seed % 8];
  const double hidden = seed / 8 % 2 == 0 ? 1 : 0;
  const bool hand = seed / 16 % 2 == 0;
  const std::string model = dice.one_of({"fer", "fr3", "fr3v2"});
  c.two = type.find("dual") != type.npos || type == "coupled_ufic";
  for (std::size_t i = 0; i < (c.two ? 2 : 1); ++i) {
    SceneArm arm = arm_of(i, model, hand, hidden);
    for (auto& angle : arm.q_start) angle += dice.uniform(-0.2, 0.2);
    c.scene.arms.push_back(arm);
  }
  InstanceConfig law{.name = "law", .type = type, .arms = {0}, .contact = {}};
  if (c.two) law.arms = {0, 1};
  const Registry registry = Registry::with_builtins();
  const int extreme = static_cast<int>(dice.uniform(0, 3));  // all greatest, all least, or drawn
  const JointVector bearable = bearable_damping(*build_controller_model(c.scene.arms[0]));
  for (const ParameterSpec& spec : registry.controllet(type)->descriptor.parameters) {
    if (!is_gain(spec)) continue;
    const std::size_t size = spec.size == ParameterSpec::kPerJoint ? 7 : spec.size;
    std::vector<double> values;
    for (std::size_t k = 0; k < size; ++k) {
      double most = spec.max;
      if (spec.name == "damping_nms_per_rad" && size == 7)  // what this arm's model bears
        most = std::min(most, bearable[static_cast<Eigen::Index>(k)]);
      if (!spec.choices.empty())
        values.push_back(std::floor(dice.uniform(0, static_cast<double>(spec.choices.size()) - 1e-9)));
      else
        values.push_back(extreme == 0 ? most : extreme == 1 ? spec.min : dice.one_of({spec.min, most}));
    }
    // The pseudo-inverses are not consistent with the inertia: a bare wrist does not bear all of their gains.
    if (spec.name == "projector" && !hand) values = {0};
    law.parameters.push_back({spec.name, values});
  }
  c.scene.controllets = {law};
  c.scene.active = {"law"};
  c.name = std::to_string(seed) + ": " + type + ", " + c.scene.plant.name + " " + model +
           (hand ? " with" : " without") + " hand, rotors hidden " + std::to_string(hidden);
  for (const auto& parameter : law.parameters) {
    c.name += "\n  " + parameter.name;
    for (const double value : parameter.values) c.name += " " + std::to_string(value);
  }
  return c;
}

struct Outcome {
  double share = 0;  // of the joints' greatest speeds
  double rest = 0;   // speed in the last 0.3 s [rad/s]
  std::string taken_out;
};

Outcome run(const Case& c, Backend& backend, int cycles = 2500) {
  static const Registry registry = Registry::with_builtins();
  const CycleConfig config = build_cycle_config(c.scene);
  ControlCycle cycle(config, registry, backend);
  MultimodeController& modes = cycle.modes();
  modes.activate_at_start(start_set(c.scene, modes));
  Outcome outcome;
  backend.start();
  for (int n = 0; n < cycles; ++n) {
    const int k = n % 2500;
    if (k == 200 || k == 1300) {  // there and back
      for (Reference& input : modes.instance(modes.find("law")).inputs()) {
        if (input.spec().quantity == Quantity::joints) {
          Target target;
          target.size = 7;
          for (std::size_t i = 0; i < 7; ++i)
            target.values[i] = c.scene.arms[0].q_start[static_cast<Eigen::Index>(i)] + (k == 200 ? 0.1 : 0);
          target.duration_s = 1;
          input.post(target);
        } else if (input.spec().quantity == Quantity::pose) {
          Pose X = input.pose();
          const double side = k == 200 ? 1 : -1;
          X.position += side * Vector3(0.05, 0.05, -0.05);
          X.rotation = exp_rotation(side * Vector3(0.1, -0.1, 0.2)) * X.rotation;
          input.post(pose_target(X, 1));
        }
      }
    }
    cycle.step(backend.wait());
    for (std::size_t i = 0; i < c.scene.arms.size(); ++i) {
      const JointVector& dq = cycle.data().state[i].dq;
      outcome.share = std::max(
          outcome.share, dq.cwiseQuotient(c.scene.arms[i].safety.joints.dq_max).lpNorm<Eigen::Infinity>());
      if (n >= cycles - 300) outcome.rest = std::max(outcome.rest, dq.lpNorm<Eigen::Infinity>());
    }
  }
  backend.finish();
  for (std::size_t i = 0; i < c.scene.arms.size(); ++i) {
    for (std::size_t k = 1; k < static_cast<std::size_t>(Intervention::count_); ++k) {
      const auto rule = static_cast<Intervention>(k);
      const bool clamps = rule == Intervention::torque_rate_clamped || rule == Intervention::torque_clamped;
      if (!clamps && cycle.safety().counted(i, rule) > 0) outcome.taken_out = to_string(rule);
    }
  }
  return outcome;
}

TEST(Gains, AtTheirBoundsNoneEndsInATrip) {
  test::Series series;
  for (std::uint32_t seed = 0; seed < 512; ++seed) {
    if (!series.takes(seed % 11 == 0)) continue;
    const Case c = draw(seed);
    MujocoBackend backend(c.scene, {.pace = Pace::unpaced});
    const Outcome outcome = run(c, backend);
    series.record("speed_share", outcome.share);
    EXPECT_EQ(outcome.taken_out, "") << c.name;
    EXPECT_LT(outcome.share, 0.8) << c.name;
  }
}

// As programs meet arms by default: in this process, and behind the arms' control interface.
TEST(Gains, DefaultsLoseNoArm) {
  static const Registry registry = Registry::with_builtins();
  const int cycles = test::full_series() ? 60000 : 2500;
  test::Series series;
  int n = 0;
  for (const ControlletType& law : registry.controllets()) {
    const ControlletDescriptor& descriptor = law.descriptor;
    for (int i = 0; i < 24; ++i) {
      if (!series.takes(n++ % 7 == 0)) continue;
      const std::string model = std::array{"fer", "fr3", "fr3v2"}[static_cast<std::size_t>(i % 3)];
      const bool hand = i / 3 % 2 == 0, wire = i / 6 % 2 == 1;
      Case c;
      c.scene.plant = i / 12 == 0 ? PlantFidelity::ideal() : PlantFidelity::realistic();
      c.name = descriptor.type + ", " + c.scene.plant.name + " " + model + (hand ? " with" : " without") +
               " hand" + (wire ? ", virtual" : "");
      InstanceConfig config{.name = "law", .type = descriptor.type};
      for (std::size_t arm = 0; arm < descriptor.arms + descriptor.observes; ++arm) {
        c.scene.arms.push_back(arm_of(arm, model, hand, SceneArm().rotor_hidden));
        (arm < descriptor.arms ? config.arms : config.observes).push_back(arm);
      }
      c.scene.controllets = {config};
      c.scene.active = {"law"};
      std::unique_ptr<Backend> backend;
      if (wire)
        backend = std::make_unique<VirtualBackend>(c.scene, VirtualPace::unpaced, nullptr);
      else
        backend = std::make_unique<MujocoBackend>(c.scene, MujocoOptions{.pace = Pace::unpaced});
      const Outcome outcome = run(c, *backend, cycles);
      EXPECT_EQ(outcome.taken_out, "") << c.name;
      EXPECT_LT(outcome.share, 0.8) << c.name;
    }
  }
}

}  // namespace
}  // namespace multipanda::gains_test
