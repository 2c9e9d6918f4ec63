#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// A hold that cannot compute a torque is reported where the arm would have needed it, once.
namespace multipanda::hold_report_test {
namespace {

using test::TestLoop;

// The hold's damping at this velocity asks for far more than any joint has.
constexpr double kAbsurd = 1e6;  // [rad/s]

struct HoldReport : testing::Test {
  HoldReport() : loop(2, {{.name = "s0", .type = "spring", .arms = {0}}}, test::test_registry(), 256) {}

  // Reports of the first arm's hold since the last call.
  int reports() {
    int count = 0;
    RecordRing& ring = *loop.cycle.record();
    for (const Event* event; (event = ring.events.front()) != nullptr; ring.events.pop()) {
      count += event->kind == EventKind::intervention &&
               event->intervention == Intervention::torque_implausible && event->arm == 0 &&
               event->instance == loop.find("arm0_hold");
    }
    while (ring.ring.front() != nullptr) ring.ring.pop();
    return count;
  }
  std::uint64_t counted() { return loop.cycle.safety().counted(0, Intervention::torque_implausible); }

  TestLoop loop;
};

TEST_F(HoldReport, AnArmInReflexIsNotReported) {
  loop.steps(2);
  loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm != 0) return;
    state.mode = ArmMode::reflex;
    state.dq = JointVector::Constant(7, kAbsurd);
  };
  loop.steps(100);
  EXPECT_EQ(loop.world.torque(0).norm(), 0);
  EXPECT_EQ(counted(), 0u);
  EXPECT_EQ(reports(), 0);
}

TEST_F(HoldReport, AFailingHoldIsCountedPerCycleAndReportedOnceWithItsTime) {
  loop.steps(2);
  loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == 0) state.dq = JointVector::Constant(7, kAbsurd);
  };
  loop.steps(100);
  EXPECT_EQ(counted(), 100u);
  EXPECT_EQ(reports(), 1);
}

// After another owner a failing hold is news again.
TEST_F(HoldReport, AHoldThatFailsAgainLaterIsReportedAgain) {
  loop.steps(2);
  for (int round = 1; round <= 2; ++round) {
    loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
      if (arm == 0) state.dq = JointVector::Constant(7, kAbsurd);
    };
    loop.steps(5);
    EXPECT_EQ(reports(), 1) << round;
    loop.world.tamper = nullptr;
    ASSERT_TRUE(loop.activate({"s0"}).accepted());
    ASSERT_TRUE(loop.ask({.deactivate = loop.set({"s0"})}).accepted());
    EXPECT_EQ(reports(), 0);
  }
}

}  // namespace
}  // namespace multipanda::hold_report_test
