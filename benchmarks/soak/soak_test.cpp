#include "benchmarks/soak/soak.hpp"

#include <filesystem>
#include <limits>
#include <random>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "benchmarks/soak/fault_storm.hpp"
#include "benchmarks/soak/invariants.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

using testing::Contains;
using testing::Field;
using testing::HasSubstr;

// Two arms with their holds, and a controllet "both" of both arms.
class InvariantsTest : public testing::Test {
 protected:
  InvariantsTest() {
    layout.arms = {{"left", 7}, {"right", 7}};
    layout.instances = {{.name = "left_hold", .type = "hold", .arms = 1},
                        {.name = "right_hold", .type = "hold", .arms = 2},
                        {.name = "both", .type = "dual_cartesian_impedance", .arms = 3}};
    const Invariants::ArmBounds bounds{joint_constant(7, 50), joint_constant(7, 1000)};
    invariants = std::make_unique<Invariants>(layout, std::vector{bounds, bounds});
    cycle = CycleRecord(2, 0, 0);
    cycle.arms[0].owner = cycle.arms[1].owner = 2;
    cycle.arms[0].due = cycle.arms[1].due = true;
    check();
    counts[0].periods_missed = 1;  // the first cycle waited for the other arm
    check();
    EXPECT_EQ(invariants->count(), 0u);
  }

  void check(ArmSet disturbed = {}) {
    ++cycle.cycle;
    invariants->check(cycle, active, counts, disturbed);
  }
  void expect(const char* text) {
    EXPECT_EQ(invariants->count(), 1u);
    EXPECT_THAT(invariants->violations(), Contains(Field(&BrokenInvariant::what, HasSubstr(text))));
  }

  RecordLayout layout;
  std::unique_ptr<Invariants> invariants;
  CycleRecord cycle;
  std::uint64_t active = 4;  // both
  std::array<Invariants::ArmCount, 2> counts;
};

TEST_F(InvariantsTest, WhatIsRightIsNotReported) {
  cycle.arms[0].tau_cmd[3] = -50;
  counts[1].torque_rate_max = 1000;
  check();
  ++counts[1].periods_missed;
  ++counts[1].motions_ended;
  check(ArmSet::of(1));
  EXPECT_EQ(invariants->count(), 0u);
}

TEST_F(InvariantsTest, AnArmWithoutAnOwner) {
  active = 1;  // left_hold
  cycle.arms[0].owner = 0;
  check();
  expect("right has 0 active owners");
}

TEST_F(InvariantsTest, AnArmWithTwoOwners) {
  active = 6;  // right_hold and both
  check();
  expect("right has 2 active owners");
}

TEST_F(InvariantsTest, ATorqueOfAnInstanceThatIsNotActive) {
  cycle.arms[0].owner = 0;
  check();
  expect("its torque is of instance 0");
}

TEST_F(InvariantsTest, TorquesBeyondTheirLimitAndNoNumbers) {
  cycle.arms[0].tau_cmd[6] = 50.1;
  check();
  expect("left: torque of joint 7 is 50.1 N m, limit 50 N m");
  cycle.arms[0].tau_cmd[6] = std::numeric_limits<double>::quiet_NaN();
  check();
  EXPECT_EQ(invariants->count(), 2u);
}

TEST_F(InvariantsTest, TorqueRates) {
  counts[1].torque_rate_max = 1001;
  check();
  expect("right received a torque rate of 1001.0 N m/s");
}

TEST_F(InvariantsTest, AnArmThatNobodyDisturbedMissesAPeriodOrStops) {
  counts[0].periods_missed += 3;
  check(ArmSet::of(1));
  expect("left had no command in 3 of its periods");
  counts[0].motions_ended = 1;
  check(ArmSet::of(1));
  EXPECT_EQ(invariants->count(), 2u);
}

TEST_F(InvariantsTest, ACycleThatIsMissing) {
  ++cycle.cycle;
  check();
  expect("cycle 4 follows cycle 2");
}

TEST_F(InvariantsTest, AControlletThatIsTakenOffWithoutAFault) {
  Event event{.kind = EventKind::intervention, .intervention = Intervention::joint_velocity_limit};
  event.arm = 0;
  event.instance = 2;
  invariants->check(event, ArmSet::of(1));  // a partner of a disturbed arm
  event.intervention = Intervention::torque_rate_clamped;
  invariants->check(event, {});
  EXPECT_EQ(invariants->count(), 0u);
  event.intervention = Intervention::joint_velocity_limit;
  event.joint = 3;
  event.values = {2.5, 2.175};
  invariants->check(event, {});
  expect("left was held: joint velocity limit (joint 4: 2.5, limit 2.175 rad/s)");
}

// A motion along a known path under a known torque: both books hold the integral of its power.
TEST(WorkBalance, BothBalancesHoldTheIntegralOfThePower) {
  WorkBalance work;
  const auto q = [](int k) { return joint_constant(7, 0.3 * std::sin(2e-3 * k)); };
  const auto tau = [](int k) { return joint_constant(7, 5 * std::cos(2e-3 * k)); };
  constexpr int kPeriods = 1571;  // to 3.142 rad
  for (int k = 0; k <= kPeriods; ++k) {
    const JointVector now = tau(k);
    work.arm_period(q(k), &now);
    work.state(q(k), now, true, k > 0);
  }
  // 7 int 5 cos(s) 0.3 cos(s) ds over half a period of the sine.
  EXPECT_NEAR(work.of_arm(), 7 * 1.5 * 3.14159265 / 2, 1e-2);
  EXPECT_NEAR(work.difference(), 0, 1e-9);
}

TEST(WorkBalance, ATorqueThatTheProgramDoesNotKnowShows) {
  WorkBalance work;
  for (int k = 0; k <= 1000; ++k) {
    const JointVector q = joint_constant(7, 1e-3 * k);
    const JointVector in_use = joint_constant(7, 2), believed = joint_constant(7, 1);
    work.arm_period(q, &in_use);
    work.state(q, believed, true, k > 0);
  }
  EXPECT_NEAR(work.difference(), -7.0, 1e-9);
}

TEST(WorkBalance, WhatALostStateHidesIsBookedAsUnseen) {
  WorkBalance work;
  work.state(joint_constant(7, 0), joint_constant(7, 1), true, false);
  work.state(joint_constant(7, 0.01), joint_constant(7, 3), false, true);
  EXPECT_NEAR(work.of_program(), 7 * 2 * 0.01, 1e-12);
  EXPECT_NEAR(work.unseen(), 7 * 2 * 0.01, 1e-12);
}

class DiskTroubleTest : public testing::Test {
 protected:
  DiskTroubleTest() { std::filesystem::create_directories(folder); }
  ~DiskTroubleTest() override { std::filesystem::remove_all(folder); }
  void run(bool full, bool paced = false) {
    RecordLayout layout;
    layout.arms = {{"left", 7}};
    layout.instances = {{.name = "left_hold", .type = "hold", .arms = 1}};
    DiskTrouble disk(folder, layout);
    disk.begin(0, full, 2);
    CycleRecord cycle(1, 0, 0);
    std::mt19937 random(3);  // numbers that do not compress
    std::uniform_real_distribution<double> number(-1, 1);
    for (int k = 0; k <= 2100; ++k) {
      cycle.cycle = static_cast<std::uint64_t>(k);
      cycle.t = LoopTime::from_seconds(1e-3 * k);
      for (double& x : cycle.arms[0].tau_cmd) x = number(random);
      disk.take(cycle);
      if (paced && k % 10 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_THAT(disk.take_findings(), testing::IsEmpty());
    EXPECT_EQ(disk.written() + disk.lost(), 2001u);
    EXPECT_TRUE(std::filesystem::is_empty(folder));
    if (!full) {
      EXPECT_EQ(disk.written(), 500u);
    }
  }
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("multipanda_disk_trouble_" + std::to_string(::getpid()));
};

TEST_F(DiskTroubleTest, OnASlowDiskTheRestIsCounted) { run(false); }
TEST_F(DiskTroubleTest, OnAFullDiskEveryRecordIsTakenOrCounted) { run(true); }
TEST_F(DiskTroubleTest, OnAFullDiskAWriterThatKeepsUpSaysWhatIsMissing) { run(true, true); }

// The same seed gives the same run, whatever the computer does besides.
TEST(Soak, IsTheSameForTheSameSeedAndKeepsItsInvariants) {
  OpenedScene opened = open_scene("two_arms");
  const auto folder =
      std::filesystem::temp_directory_path() / ("multipanda_soak_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const SoakOptions options{.duration_s = 8,
                            .seed = 5,
                            .mean_interval_s = 0.5,
                            .bare_joints = false,
                            .folder = folder,
                            .progress = {}};
  const SoakResult first = soak(opened.scene, options), second = soak(opened.scene, options);
  std::filesystem::remove_all(folder);
  for (const BrokenInvariant& broken : first.violations)
    ADD_FAILURE() << broken.at_s << " s: " << broken.what;
  EXPECT_GE(first.faults.size(), 5u);
  EXPECT_GT(first.switches, 0u);
  ASSERT_EQ(first.arms.size(), second.arms.size());
  EXPECT_EQ(first.cycles, second.cycles);
  for (std::size_t i = 0; i < first.arms.size(); ++i) {
    EXPECT_EQ(first.arms[i].work_j, second.arms[i].work_j);
    EXPECT_EQ(first.arms[i].periods_missed, second.arms[i].periods_missed);
  }
}

}  // namespace
}  // namespace multipanda
