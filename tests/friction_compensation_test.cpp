// Friction compensation over the `realistic` plant (friction of the robot model, 50 Hz torque tracking, delay
// and noise).
#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "models/robot_description.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::friction_compensation_test {
namespace {

using testing::IsEmpty;

// Two joints swing for 9 s, then the arm rests for 2 s.
std::string scene_text(const std::string& features) {
  return "arms:\n"
         "  - {name: left, model: fer, known_friction: model}\n"
         "controllets:\n"
         "  - {name: joint, type: joint_impedance, arms: left, features: " +
         features +
         "}\n"
         "active: [joint]\n"
         "timeline:\n"
         "  - {at_s: 0.5, motion: {controllet: joint, input: joints, sine: [0.2, 0.1, 0, 0.2, 0, 0.2, 0], "
         "period_s: 2.8, cycles: 3, ramp_s: 0.5}}\n";
}

struct Outcome {
  double error_rms = 0;       // of the joints that move, while they do [rad]
  double compensation_j = 0;  // energy that the feature supplied
  double friction_j =
      0;  // energy that the plant's friction dissipated, from its table and the measured velocity
  double rest_range = 0;  // largest motion of a joint at rest [rad]
};

Outcome swing(const std::string& features) {
  const Registry registry = Registry::with_builtins();
  Scene scene = parse_scene(scene_text(features), "friction.yaml", registry);
  scene.plant = PlantFidelity::realistic();
  const JointFriction friction = load_robot("fer").friction.value();
  Outcome outcome;
  std::size_t samples = 0;
  JointArray low{}, high{};
  low.fill(1e9);
  high.fill(-1e9);
  SessionOptions options{.paced = false, .duration_s = 11};
  options.observer = [&](const CycleRecord& record) {
    const ArmSample& arm = record.arms[0];
    const double t = record.t.seconds();
    for (std::size_t j = 0; j < 7; ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const auto sigmoid = [&](double x) { return 1 / (1 + std::exp(-friction.p2[i] * x)); };
      const double taken = friction.p1[i] * (sigmoid(arm.dq[j] + friction.p3[i]) - sigmoid(friction.p3[i]));
      outcome.friction_j += taken * arm.dq[j] * 1e-3;
      outcome.compensation_j += arm.tau_feature[j] * arm.dq[j] * 1e-3;
      if (t > 10.5) {
        low[j] = std::min(low[j], arm.q[j]);
        high[j] = std::max(high[j], arm.q[j]);
      }
    }
    for (std::size_t r = 0; r < record.reference_count; ++r) {
      const auto& reference = record.references[r];
      if (reference.size != 7 || t < 1 || t > 8) continue;
      for (const std::size_t j : {0u, 1u, 3u, 5u}) {
        const double e = reference.values[j] - arm.q[j];
        outcome.error_rms += e * e;
        ++samples;
      }
    }
  };
  Session session(std::move(scene), registry, std::move(options));
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), IsEmpty()) << features;
  EXPECT_THAT(summary.interventions, IsEmpty()) << features;
  EXPECT_GT(samples, 10'000u);
  outcome.error_rms = std::sqrt(outcome.error_rms / static_cast<double>(samples));
  for (std::size_t j = 0; j < 7; ++j) outcome.rest_range = std::max(outcome.rest_range, high[j] - low[j]);
  return outcome;
}

TEST(FrictionCompensation, TracksBetterAndSuppliesLessThanFrictionDissipates) {
  const Outcome without = swing("[]"), with = swing("[friction_compensation]");
  EXPECT_LT(with.error_rms, 0.6 * without.error_rms);
  EXPECT_EQ(without.compensation_j, 0);
  EXPECT_GT(with.compensation_j, 0.3 * with.friction_j);
  EXPECT_LT(with.compensation_j, 0.85 * with.friction_j);  // the gain is 0.8
  // No chatter: at rest, the joints move as little as without the feature.
  EXPECT_LT(with.rest_range, without.rest_range + 2e-4);
  RecordProperty("error_rms_without", std::to_string(without.error_rms));
  RecordProperty("error_rms_with", std::to_string(with.error_rms));
}

// On a plant without friction the compensation would drive the joints, so the cycle is not built.
TEST(FrictionCompensation, IsRefusedWhereThereIsNoFriction) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(scene_text("[friction_compensation]"), "friction.yaml", registry);
  try {
    Session session(scene, registry, {.paced = false});
    FAIL() << "was built";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("friction_compensation"));
    EXPECT_THAT(error.what(), testing::HasSubstr("'left'"));
  }
}

}  // namespace
}  // namespace multipanda::friction_compensation_test
