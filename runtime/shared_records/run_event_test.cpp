#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "arm_interface/arm_error.hpp"
#include "runtime/shared_records/shared_records.hpp"

namespace multipanda::run_event_test {
namespace {

using testing::ElementsAre;

RecordLayout layout() {
  RecordLayout layout;
  layout.arms = {{"left", 7}, {"right", 7}};
  layout.instances = {{.name = "left_hold", .type = "hold", .arms = 1},
                      {.name = "right_hold", .type = "hold", .arms = 2},
                      {.name = "pose", .type = "cartesian_impedance", .arms = 1}};
  return layout;
}

class RunEventsTest : public testing::Test {
 protected:
  RunEventsTest() : events_(layout()), record_(2, 0, 0) { record_.arms[1].owner = 1; }
  // Kinds and arms of what the next cycle brings.
  std::vector<std::string> next(const std::map<std::string, std::string>& reasons = {}) {
    ++record_.cycle;
    record_.t.ns += 1'000'000;
    std::vector<std::string> kinds;
    for (const auto& event : events_.take(record_, reasons)) {
      EXPECT_EQ(event.cycle, record_.cycle);
      EXPECT_EQ(event.t, record_.t);
      kinds.push_back(event.kind + " " + event.arm);
      text_ = event.text;
    }
    return kinds;
  }

  RunEvents events_;
  CycleRecord record_;
  std::string text_;
};

TEST_F(RunEventsTest, AnOwnerOfOneCycleIsSeen) {
  EXPECT_THAT(next(), ElementsAre());
  record_.arms[0].owner = 2;
  EXPECT_THAT(next(), ElementsAre("controllet left"));
  EXPECT_EQ(text_, "pose after left_hold");
  record_.arms[0].owner = 0;
  EXPECT_THAT(next(), ElementsAre("controllet left"));
  EXPECT_THAT(next(), ElementsAre());
}

TEST_F(RunEventsTest, AnErrorOfOneCycleIsSeenWithItsReason) {
  EXPECT_THAT(next(), ElementsAre());
  record_.arms[1].errors = error_bit(ArmError::joint_reflex);
  EXPECT_THAT(next({{"right", "joint 4 hit something"}}), ElementsAre("error right"));
  EXPECT_EQ(text_, "joint 4 hit something");
  record_.arms[1].errors = 0;
  EXPECT_THAT(next(), ElementsAre("recovered right"));
}

TEST_F(RunEventsTest, AnErrorAtTheStartIsOne) {
  record_.arms[0].errors = error_bit(ArmError::joint_reflex);
  EXPECT_THAT(next(), ElementsAre("error left"));
  EXPECT_EQ(text_, "joint_reflex");
}

TEST_F(RunEventsTest, AContactBeginsAtItsForceAndEndsAfterRest) {
  record_.arms[0].has_contact_truth = true;
  EXPECT_THAT(next(), ElementsAre());
  record_.arms[0].F_K_W_true = {12, 0, 16.1, 0, 0, 0};  // 20.08 N
  EXPECT_THAT(next(), ElementsAre("contact left"));
  EXPECT_EQ(text_, "20.1 N at the end effector");
  int cycles = 0;
  record_.arms[0].F_K_W_true = {};
  while (next().empty()) ASSERT_LT(++cycles, 1000);
  EXPECT_EQ(cycles + 1, 50);  // [ms]
  EXPECT_THAT(next(), ElementsAre());
}

TEST_F(RunEventsTest, AContactThatBouncesIsOneContact) {
  record_.arms[0].has_wrench_estimate = true;
  EXPECT_THAT(next(), ElementsAre());
  int contacts = 0;
  for (int k = 0; k < 200; ++k) {
    record_.arms[0].F_K_W_est = {0, 0, k % 20 == 0 ? -30.0 : 0.0, 0, 0, 0};
    contacts += static_cast<int>(next().size());
  }
  EXPECT_EQ(contacts, 1);
}

TEST_F(RunEventsTest, AnElbowInContactIsNamedByItsJoint) {
  record_.arms[1].has_tau_ext = true;
  EXPECT_THAT(next(), ElementsAre());
  record_.arms[1].tau_ext[3] = -21;
  EXPECT_THAT(next(), ElementsAre("contact right"));
  EXPECT_EQ(text_, "21.0 N m at joint 4");
}

TEST_F(RunEventsTest, AGrasp) {
  record_.arms[0].has_gripper = true;
  EXPECT_THAT(next(), ElementsAre());
  record_.arms[0].gripper_grasped = true;
  record_.arms[0].gripper_width = 0.03;
  EXPECT_THAT(next(), ElementsAre("grasped left"));
  EXPECT_EQ(text_, "30.0 mm");
  record_.arms[0].gripper_grasped = false;
  EXPECT_THAT(next(), ElementsAre("released left"));
}

TEST_F(RunEventsTest, EventsOfTheLoop) {
  Event stop{.kind = EventKind::stopped, .t = LoopTime{5}, .cycle = 7};
  stop.arms = 3;
  const auto stopped = events_.take(stop);
  ASSERT_EQ(stopped.size(), 2u);  // one per arm
  EXPECT_EQ(stopped[0].arm + " " + stopped[1].arm, "left right");
  EXPECT_EQ(stopped[0].kind, "stopped");
  EXPECT_EQ(stopped[0].cycle, 7u);
  Event limit{.kind = EventKind::intervention, .intervention = Intervention::reference_stale};
  limit.arm = 1;
  const auto seen = events_.take(limit);
  ASSERT_EQ(seen.size(), 1u);
  EXPECT_EQ(seen[0].arm, "right");
  EXPECT_EQ(seen[0].text.find(' '), std::string::npos) << seen[0].text;
}

}  // namespace
}  // namespace multipanda::run_event_test
