#include <array>
#include <functional>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "core/cycle/sample_state.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Each recorded number is the one that was read, decided or sent.
namespace multipanda::record_cycle_test {
namespace {

using test::TestLoop;

// n, n + 1, ...: no two fields have a number in common.
JointVector counted_from(double first) {
  JointVector values = joint_constant(7, 0);
  std::iota(values.begin(), values.end(), first);
  return values;
}

void expect_counted(std::span<const double> found, double first, std::size_t size = 7) {
  for (std::size_t i = 0; i < size; ++i) EXPECT_EQ(found[i], first + static_cast<double>(i));
}

TEST(RecordState, HoldsEveryField) {
  ArmState state;
  state.sequence = 1;
  state.t_robot.ns = 2;
  state.age_s = 3;
  state.errors = 4;
  state.config_version = 5;
  state.command_success_rate = 0.6;
  state.gripper.width = 0.07;
  state.gripper.max_width = 0.08;
  state.q = counted_from(10);
  state.dq = counted_from(20);
  state.tau_J = counted_from(30);
  state.tau_J_d = counted_from(40);
  state.tau_ext_hat = counted_from(50);
  state.F_K_W_est.vector = counted_from(60).head<6>();
  state.F_K_W_true.vector = counted_from(70).head<6>();
  ArmSample sample;
  set_state(sample, state);
  EXPECT_EQ(sample.sequence, 1u);
  EXPECT_EQ(sample.t_robot_ns, 2);
  EXPECT_EQ(sample.age_s, 3);
  EXPECT_EQ(sample.errors, 4u);
  EXPECT_EQ(sample.config_version, 5u);
  EXPECT_EQ(sample.command_success_rate, 0.6);
  EXPECT_EQ(sample.gripper_width, 0.07);
  EXPECT_EQ(sample.gripper_max_width, 0.08);
  expect_counted(sample.q, 10);
  expect_counted(sample.dq, 20);
  expect_counted(sample.tau_J, 30);
  expect_counted(sample.tau_J_d, 40);
  expect_counted(sample.tau_ext, 50);
  expect_counted(sample.F_K_W_est, 60, 6);
  expect_counted(sample.F_K_W_true, 70, 6);
}

TEST(RecordState, HoldsTheReportOfTheInterface) {
  ArmState state;
  InterfaceReport& report = state.report;
  report.present = true;
  report.q_d = counted_from(10);
  report.dq_d = counted_from(20);
  report.theta = counted_from(30);
  report.elbow = {0.4, -1};
  report.X_BE_d.position = {1, 2, 3};
  report.X_BE_c.position = {4, 5, 6};
  report.joint_contact = 1;
  report.joint_collision = 2;
  report.cartesian_contact = 3;
  report.cartesian_collision = 4;
  report.last_motion_errors = 5;
  ArmSample sample;
  set_state(sample, state);
  EXPECT_TRUE(sample.has_report);
  expect_counted(sample.q_d, 10);
  expect_counted(sample.dq_d, 20);
  expect_counted(sample.theta, 30);
  EXPECT_EQ(sample.elbow, report.elbow);
  EXPECT_EQ(sample.X_BE_d[2], 3);
  EXPECT_EQ(sample.X_BE_c[2], 6);
  EXPECT_EQ(sample.joint_contact, 1u);
  EXPECT_EQ(sample.joint_collision, 2u);
  EXPECT_EQ(sample.cartesian_contact, 3u);
  EXPECT_EQ(sample.cartesian_collision, 4u);
  EXPECT_EQ(sample.last_motion_errors, 5u);
}

// Other fields, joints that the arm does not have and the next arm stay as they are.
TEST(RecordState, WritesNothingElse) {
  ArmState state;
  state.q = state.dq = state.tau_J = state.tau_J_d = state.tau_ext_hat = joint_constant(1, 5);
  std::vector<ArmSample> of_two_arms(2);
  ArmSample& sample = of_two_arms[0];
  of_two_arms[1].sequence = 4;
  sample.interventions = 3;
  sample.owner = 2;
  for (JointArray* values : {&sample.q, &sample.dq, &sample.tau_J, &sample.tau_J_d, &sample.tau_ext}) {
    values->fill(9);
  }
  sample.tau_controllet.fill(6);
  sample.tau_feature.fill(7);
  sample.tau_cmd.fill(8);
  set_state(sample, state);
  EXPECT_TRUE(sample.has_tau_ext) << "of one joint";
  EXPECT_EQ(sample.interventions, 3u);
  EXPECT_EQ(sample.owner, 2);
  EXPECT_EQ(of_two_arms[1].sequence, 4u);
  for (const JointArray* values : {&sample.q, &sample.dq, &sample.tau_J, &sample.tau_J_d, &sample.tau_ext}) {
    EXPECT_EQ((*values)[0], 5);
    for (std::size_t i = 1; i < values->size(); ++i) EXPECT_EQ((*values)[i], 9);
  }
  for (std::size_t i = 0; i < sample.tau_cmd.size(); ++i) {
    EXPECT_EQ(sample.tau_controllet[i], 6);
    EXPECT_EQ(sample.tau_feature[i], 7);
    EXPECT_EQ(sample.tau_cmd[i], 8);
  }
}

TEST(RecordState, HoldsEveryFlagAndMode) {
  using Flag = bool ArmSample::*;
  const std::vector<std::pair<Flag, std::function<void(ArmState&)>>> flags = {
      {&ArmSample::has_tau_ext, [](ArmState& state) { state.tau_ext_hat = joint_constant(7, 0); }},
      {&ArmSample::has_wrench_estimate, [](ArmState& state) { state.has_wrench_estimate = true; }},
      {&ArmSample::has_contact_truth, [](ArmState& state) { state.has_contact_truth = true; }},
      {&ArmSample::has_gripper, [](ArmState& state) { state.gripper.present = true; }},
      {&ArmSample::gripper_grasped, [](ArmState& state) { state.gripper.grasped = true; }},
      {&ArmSample::gripper_moving, [](ArmState& state) { state.gripper.moving = true; }}};
  ArmSample sample;
  for (std::size_t set = 0; set < flags.size(); ++set) {
    ArmState state;
    flags[set].second(state);
    set_state(sample, state);
    for (std::size_t k = 0; k < flags.size(); ++k) EXPECT_EQ(sample.*flags[k].first, k == set) << set << k;
  }
  for (const ArmMode mode : {ArmMode::other, ArmMode::reflex, ArmMode::disconnected}) {
    ArmState state;
    state.mode = mode;
    set_state(sample, state);
    EXPECT_EQ(sample.mode, static_cast<std::uint8_t>(mode));
  }
}

TEST(RecordCycle, HoldsWhatWasDecidedForEachArm) {
  TestLoop loop(2, {{.name = "s1", .type = "spring", .arms = {1}, .features = {"push"}}},
                test::test_registry(), 300);
  loop.modes().activate_at_start(loop.set({"s1"}));
  loop.world.due_in_step = [](std::uint64_t step) { return step == 20 ? ArmSet::of(1) : ArmSet::all(2); };
  for (int k = 0; k < 30; ++k) {
    if (k == 10) loop.modes().stop(ArmSet::of(0));
    loop.step();
    const CycleData& data = loop.cycle.data();
    const CycleRecord& record = *loop.cycle.record()->ring.front();
    EXPECT_EQ(record.arms[0].due, k != 20);
    EXPECT_EQ(record.arms[1].due, true);
    EXPECT_EQ(record.arms[0].age_s, k == 20 ? 0.001 : 0.0);
    EXPECT_EQ(record.arms[0].interventions, k < 10 ? 0u : 1u);
    EXPECT_EQ(record.arms[1].interventions, 0u);
    const ArmSample& arm = record.arms[1];
    for (std::size_t i = 0; i < 7; ++i) {
      const auto joint = static_cast<Eigen::Index>(i);
      EXPECT_EQ(arm.tau_controllet[i], data.tau_controllet[1][joint]);
      EXPECT_NEAR(arm.tau_feature[i], 0.5 * (k + 1) / 200, 1e-12) << "fades in within 0.2 s";
      EXPECT_NEAR(arm.tau_cmd[i], arm.tau_controllet[i] + arm.tau_feature[i], 1e-12);
    }
    loop.cycle.record()->ring.pop();
  }
}

// Each stage takes some time, and nothing is counted twice or left out.
TEST(RecordCycle, StageTimesAddUp) {
  TestLoop loop(1, {}, test::test_registry(), 1);
  for (int k = 0; k < 20; ++k) {
    loop.step();
    const StageTimes& times = loop.cycle.record()->ring.front()->stages;
    const std::array stages{times.read, times.controllets, times.features, times.safety, times.write};
    EXPECT_EQ(std::accumulate(stages.begin(), stages.end(), 0), times.total);
    for (const std::int32_t stage : stages) EXPECT_GT(stage, 0);
    loop.cycle.record()->ring.pop();
  }
}

}  // namespace
}  // namespace multipanda::record_cycle_test
