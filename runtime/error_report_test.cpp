// Explanations of an arm's errors: from synthetic records, and for simulated arms compared with the arm's own
// finding (SimulatedArm::reflex_detail), which the explanation does not use.
#include "runtime/error_report.hpp"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <random>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "backends/simulated_arm/from_scene.hpp"
#include "backends/simulated_arm/simulated_arm.hpp"
#include "core/state/external_force.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::error_report_test {
namespace {

using testing::HasSubstr;

const char* const kScene =
    "name: explained\n"
    "arms:\n"
    "  - {name: left, model: fr3, base: {position_m: [0.1, 0.2, 0.3], rpy_rad: [0.2, -0.3, 0.4]}}\n"
    "controllets:\n"
    "  - {name: joints, type: joint_impedance, arms: left}\n"
    "active: [joints]\n";

void copy(const JointVector& from, JointArray& to) { std::copy_n(from.data(), from.size(), to.begin()); }

// A simulated arm in free space as the loop sees it: its reports are recorded as the loop would record them,
// with the loop's own estimate of forces.
class WatchedArm {
 public:
  WatchedArm()
      : scene_(parse_scene(kScene, "explained.yaml", registry_)),
        config_(simulated_arm_config(scene_, 0)),
        q_(JointVector(config_.model->q_home())),
        arm_(config_, q_),
        terms_(config_.model),
        observer_(config_.model->joint_count()),
        limits_(error_limits(scene_, {config_.model}, {true}).front()) {
    terms_.set_config(config_.frames, config_.tool, config_.load);
  }

  JointVector zero() const { return joint_constant(arm_.joint_count(), 0); }
  JointVector gravity(const JointVector& q) {
    terms_.update(q, zero());
    return terms_.g();
  }
  // One period: command, measurement, record. `tau` none: missed.
  void period(const JointVector* tau, const JointVector& q, const JointVector& dq,
              const JointVector& tau_link) {
    if (tau != nullptr) {
      arm_.take_command(*tau);
    } else {
      arm_.miss_command();
    }
    (void)arm_.motor_torque(q, dq, 0.001);
    arm_.measure({.q = q, .dq = dq, .tau_link = tau_link});
    ArmState state = arm_.state();
    terms_.update(state.q, state.dq);
    observer_.update({terms_.momentum(), terms_.momentum_drift(), terms_.J_V_WK()}, state);
    ArmCycle cycle{.cycle = cycles_.size() + 1, .t = {static_cast<std::int64_t>(cycles_.size()) * 1000000}};
    cycle.period_s = 0.001;
    cycle.arm.sequence = state.sequence;
    cycle.arm.errors = state.errors;
    cycle.arm.mode = static_cast<std::uint8_t>(state.mode);
    cycle.arm.due = true;
    cycle.arm.has_tau_ext = cycle.arm.has_wrench_estimate = true;
    copy(state.q, cycle.arm.q);
    copy(state.dq, cycle.arm.dq);
    copy(state.tau_J, cycle.arm.tau_J);
    copy(state.tau_ext_hat, cycle.arm.tau_ext);
    std::copy_n(state.F_K_W_est.vector.data(), 6, cycle.arm.F_K_W_est.begin());
    // A command belongs to the record before: it answers that state.
    if (tau != nullptr && !cycles_.empty()) copy(*tau, cycles_.back().arm.tau_cmd);
    cycles_.push_back(cycle);
  }
  void stand(int periods) {
    const JointVector tau = zero(), g = gravity(q_);
    for (int k = 0; k < periods; ++k) period(&tau, q_, tau, g);
  }
  ErrorExplanation explained() const { return explain(arm_.errors(), cycles_, limits_); }

  Registry registry_ = Registry::with_builtins();
  Scene scene_;
  SimulatedArmConfig config_;
  JointVector q_;
  SimulatedArm arm_;
  ModelTerms terms_;
  ExternalForceObserver observer_;
  ArmErrorLimits limits_;
  std::vector<ArmCycle> cycles_;
};

void expect_agreement(const WatchedArm& watched, ArmError expected, double tolerance = 1e-12) {
  const ReflexDetail own = watched.arm_.reflex_detail();
  const ErrorExplanation why = watched.explained();
  ASSERT_EQ(own.error, expected) << describe(own);
  EXPECT_EQ(why.detail.error, own.error);
  EXPECT_EQ(why.detail.index, own.index) << describe(own) << "; " << why.sentences.at(0);
  EXPECT_NEAR(why.detail.value, own.value, tolerance * (1 + std::abs(own.value)));
  EXPECT_NEAR(why.detail.limit, own.limit, 1e-9 * (1 + std::abs(own.limit)));
  ASSERT_GE(why.sentences.size(), 1u);
  EXPECT_THAT(why.sentences, testing::Contains(HasSubstr(std::string(to_string(expected)))));
  EXPECT_FALSE(why.cures.empty());
}

TEST(ErrorsOfSimulatedArms, MeasuredLimitsAsDetectedByTheArm) {
  std::mt19937 random(11);
  for (int trial = 0; trial < 7; ++trial) {
    const auto joint = static_cast<Eigen::Index>(trial);
    {
      WatchedArm arm;
      arm.stand(3);
      JointVector q = arm.q_;
      const bool upper = random() % 2 == 0;
      q[joint] = upper ? arm.limits_.motion.q_max[joint] + 0.01 : arm.limits_.motion.q_min[joint] - 0.01;
      const JointVector tau = arm.zero();
      arm.period(&tau, q, tau, arm.gravity(q));
      expect_agreement(arm, ArmError::joint_position_limits_violation);
    }
    {
      WatchedArm arm;
      arm.stand(3);
      JointVector dq = arm.zero();
      dq[joint] = (random() % 2 == 0 ? 1.2 : -1.2) * arm.limits_.motion.dq_max[joint];
      const JointVector tau = arm.zero();
      arm.period(&tau, arm.q_, dq, arm.gravity(arm.q_));
      expect_agreement(arm, ArmError::joint_velocity_violation);
    }
    {
      WatchedArm arm;
      arm.stand(3);
      JointVector tau_link = arm.gravity(arm.q_);
      tau_link[joint] = 1.1 * arm.limits_.tau_max[joint];
      const JointVector tau = arm.zero();
      arm.period(&tau, arm.q_, tau, tau_link);
      expect_agreement(arm, ArmError::tau_j_range_violation);
    }
  }
}

TEST(ErrorsOfSimulatedArms, Power) {
  WatchedArm power;
  power.stand(3);
  const JointVector tau = power.zero();
  power.period(&tau, power.q_, 0.9 * power.limits_.motion.dq_max, 0.9 * power.limits_.tau_max);
  expect_agreement(power, ArmError::power_limit_violation);
}

TEST(ErrorsOfSimulatedArms, ContactBeyondTheThresholds) {
  for (const bool joint_first : {true, false}) {
    WatchedArm arm;
    SetCollisionThresholds thresholds = arm.arm_.settings().thresholds;
    thresholds.nominal.torque_upper.setConstant(joint_first ? 6 : 80);
    thresholds.nominal.wrench_upper.setConstant(joint_first ? 1000 : 12);
    thresholds.nominal.torque_lower = thresholds.nominal.torque_upper;
    thresholds.nominal.wrench_lower = thresholds.nominal.wrench_upper;
    ASSERT_EQ(arm.arm_.apply(thresholds), ArmReply::done);
    arm.limits_.thresholds = thresholds;
    arm.stand(20);
    // A force of 25 N acts on the hand along an oblique direction.
    arm.terms_.update(arm.q_, arm.zero());
    Vector6 F;
    F << 14, -9, 18, 0, 0, 0;
    const JointVector tau_link = arm.gravity(arm.q_) + arm.terms_.J_V_WK().transpose() * F;
    const JointVector tau = arm.zero();
    for (int k = 0; k < 200 && arm.arm_.errors() == 0; ++k) arm.period(&tau, arm.q_, tau, tau_link);
    expect_agreement(arm, joint_first ? ArmError::joint_reflex : ArmError::cartesian_reflex, 1e-6);
  }
}

TEST(ErrorsOfSimulatedArms, ATorqueThatJumps) {
  for (Eigen::Index joint = 0; joint < 7; ++joint) {
    WatchedArm arm;
    arm.stand(5);
    JointVector tau = arm.zero();
    tau[joint] = joint % 2 == 0 ? 1.4 : -1.7;
    arm.period(&tau, arm.q_, arm.zero(), arm.gravity(arm.q_));
    expect_agreement(arm, ArmError::controller_torque_discontinuity);
  }
}

TEST(ErrorsOfSimulatedArms, PartsTooNear) {
  WatchedArm arm;
  // Folded until two parts meet: joint 4 and joint 6 at their limits bring the hand to the upper arm.
  arm.stand(3);
  JointVector q = arm.q_;
  const JointVector tau = arm.zero();
  for (int k = 0; k <= 1000 && arm.arm_.errors() == 0; ++k) {
    const double s = k / 1000.0;
    q[3] = arm.q_[3] + s * (arm.limits_.motion.q_min[3] + 0.01 - arm.q_[3]);
    q[5] = arm.q_[5] + s * (arm.limits_.motion.q_min[5] + 0.01 - arm.q_[5]);
    arm.period(&tau, q, tau, arm.gravity(q));
  }
  if (arm.arm_.errors() == 0) GTEST_SKIP() << "this arm cannot fold onto itself so";
  expect_agreement(arm, ArmError::self_collision_avoidance_violation, 1e-6);
  EXPECT_THAT(arm.explained().sentences[0], HasSubstr("Nearest: "));
}

// --- Made-up records ---

ArmErrorLimits plain_limits() {
  const JointVector one = joint_constant(7, 1);
  ArmErrorLimits limits{.joint_count = 7, .tau_max = 10 * one, .tau_rate_max = 1000 * one};
  limits.motion.q_min = -one;
  limits.motion.q_max = one;
  limits.motion.dq_max = 2 * one;
  return limits;
}

std::vector<ArmCycle> quiet_cycles(std::size_t count) {
  std::vector<ArmCycle> cycles(count);
  for (std::size_t i = 0; i < count; ++i) {
    cycles[i].cycle = i + 1;
    cycles[i].period_s = 0.001;
    cycles[i].total_ns = 20000;
    cycles[i].arm.sequence = 100 + i;
    cycles[i].arm.due = true;
  }
  return cycles;
}

TEST(ErrorExplanations, EveryFlagHasASentenceARemedyAndASectionInTheDocs) {
  std::ifstream file(std::string(MULTIPANDA_SOURCE_DIR) + "/docs/errors.md");
  std::stringstream text;
  text << file.rdbuf();
  const auto cycles = quiet_cycles(3);
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    const auto error = static_cast<ArmError>(i);
    // Without a model: errors that need one are skipped here.
    if (error == ArmError::cartesian_velocity_violation ||
        error == ArmError::self_collision_avoidance_violation)
      continue;
    const ErrorExplanation why = explain(error_bit(error), cycles, plain_limits());
    ASSERT_EQ(why.sentences.size(), 1u);
    EXPECT_THAT(why.sentences[0], testing::StartsWith(std::string(to_string(error)) + ": "));
    ASSERT_EQ(why.cures.size(), 1u);
    EXPECT_GT(why.cures[0].size(), 20u);
  }
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    const std::string name(to_string(static_cast<ArmError>(i)));
    EXPECT_THAT(text.str(), HasSubstr("`" + name + "`")) << "docs/errors.md lacks it";
  }
}

TEST(ErrorExplanations, SeveralAtOnceAndUnknownOnes) {
  const auto cycles = quiet_cycles(3);
  const auto why =
      explain(error_bit(ArmError::joint_velocity_violation) |
                  error_bit(ArmError::communication_constraints_violation) | std::uint64_t{1} << 50,
              cycles, plain_limits());
  EXPECT_EQ(why.sentences.size(), 3u);
  EXPECT_THAT(why.sentences[2], HasSubstr("unknown to this program"));
  EXPECT_TRUE(explain(1, {}, plain_limits()).sentences.empty());
}

TEST(ErrorExplanations, StateWhenTheLimitIsUnknown) {
  auto cycles = quiet_cycles(3);
  cycles.back().arm.has_tau_ext = true;
  cycles.back().arm.tau_ext[4] = -7.5;
  const auto why = explain(error_bit(ArmError::joint_reflex), cycles, plain_limits());
  EXPECT_EQ(why.detail.index, 4);
  EXPECT_DOUBLE_EQ(why.detail.value, -7.5);
  EXPECT_THAT(why.sentences[0], HasSubstr("joint 5: -7.5"));
  EXPECT_THAT(why.sentences[0], HasSubstr("unknown to this program"));
  EXPECT_THAT(why.sentences[0], testing::Not(HasSubstr("limit 0")));
}

TEST(ErrorExplanations, NameTheLateSide) {
  const std::uint64_t lost = error_bit(ArmError::communication_constraints_violation);
  struct Row {
    const char* what;
    std::function<void(std::vector<ArmCycle>&)> make;
    std::uint64_t missed;
    double answered;
    const char* said;
  };
  const std::vector<Row> rows{
      {"the way to the arm",
       [](auto& c) {
         for (auto& x : c) x.total_ns = 30000;
       },
       0, 1.0, "on the way to the arm"},
      {"own code",
       [](auto& c) {
         c[10].total_ns = 4000000;
         c[11].period_s = 0.005;
         for (std::size_t i = 11; i < c.size(); ++i) c[i].arm.sequence += 4;
       },
       4, 50.0 / 54, "4000 us to compute"},
      {"the computer",
       [](auto& c) {
         c[20].period_s = 0.025;
         for (std::size_t i = 20; i < c.size(); ++i) c[i].arm.sequence += 24;
       },
       24, 50.0 / 74, "No cycle began for 25.0 ms before cycle 21"},
      {"this arm's cable",
       [](auto& c) {
         for (std::size_t i = 40; i < 50; ++i) {
           c[i].arm.due = i == 49;
           c[i].others_due = true;
           c[i].arm.sequence = i == 49 ? 149 : 139;
         }
       },
       9, 41.0 / 50, "Packets of other arms arrived for 9 cycles"},
  };
  for (const auto& row : rows) {
    auto cycles = quiet_cycles(50);
    row.make(cycles);
    const auto why = explain(lost, cycles, plain_limits());
    EXPECT_EQ(why.missed_in_row, row.missed) << row.what;
    EXPECT_NEAR(why.answered, row.answered, 1e-9) << row.what;
    EXPECT_THAT(why.sentences[0], HasSubstr(row.said)) << row.what;
  }
}

TEST(ErrorExplanations, TorqueStepsThatWereNotSent) {
  auto cycles = quiet_cycles(10);
  for (std::size_t i = 0; i < cycles.size(); ++i) cycles[i].arm.tau_cmd[2] = 0.9 * static_cast<double>(i);
  const auto why = explain(error_bit(ArmError::controller_torque_discontinuity), cycles, plain_limits());
  EXPECT_EQ(why.detail.index, 2);
  EXPECT_NEAR(why.detail.value, 900, 1e-9);
  EXPECT_THAT(why.sentences[0], HasSubstr("commands were lost, so"));
}

// --- In a run ---

TEST(ReflexInARun, IsExplainedWithAFileOfItsLastCycles) {
  Registry registry = Registry::with_builtins();
  // An undeclared load of 3 kg exceeds the threshold of joint 4.
  std::string text = std::string(kScene) + "duration_s: 1\n";
  const std::string arm = "model: fr3,";
  text.insert(text.find(arm) + arm.size(),
              " load_present: {mass_kg: 3, inertia_kg_m2: {xx: 3e-3, yy: 3e-3, zz: 3e-3}},");
  Scene scene = parse_scene(text, "explained.yaml", registry);
  SetCollisionThresholds thresholds;
  thresholds.nominal.torque_lower = thresholds.nominal.torque_upper = joint_constant(7, 80);
  thresholds.nominal.wrench_lower.setConstant(1000);
  thresholds.nominal.wrench_upper.setConstant(1000);
  thresholds.nominal.torque_upper[3] = thresholds.nominal.torque_lower[3] = 4;
  scene.arms[0].collision = thresholds;
  ReflexDetail own;
  SessionOptions options{.paced = false};
  options.on_loop = [&own](const Tick&, const Backend& backend) {
    own = dynamic_cast<const MujocoBackend&>(backend).arm(0).reflex_detail();
  };
  std::string pattern = (std::filesystem::temp_directory_path() / "reflex_test_XXXXXX").string();
  const std::filesystem::path folder = mkdtemp(pattern.data());
  options.record = folder;
  Session session(std::move(scene), registry, options);
  session.start();
  const RunSummary summary = session.finish();
  ASSERT_EQ(summary.reflexes.size(), 1u);
  const ReflexReport& report = summary.reflexes.front();
  EXPECT_EQ(report.errors, error_bit(ArmError::joint_reflex));
  EXPECT_EQ(own.error, ArmError::joint_reflex);
  EXPECT_EQ(report.why.detail.index, own.index);
  EXPECT_NEAR(report.why.detail.value, own.value, 1e-6);
  EXPECT_DOUBLE_EQ(report.why.detail.limit, own.limit);
  EXPECT_FALSE(summary.success());
  EXPECT_EQ(report.file.parent_path(), session.directory());
  std::ifstream file(report.file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  ASSERT_GE(lines.size(), 2u);
  EXPECT_LE(lines.size(), ReflexWatch::kCycles + 1);
  const auto commas = [](const std::string& line) { return std::count(line.begin(), line.end(), ','); };
  for (const auto& line : lines) EXPECT_EQ(commas(line), commas(lines[0]));
  EXPECT_THAT(lines.back(), HasSubstr("joint_reflex"));
  EXPECT_THAT(lines.back(), testing::StartsWith(std::to_string(report.cycle) + ","));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace multipanda::error_report_test
