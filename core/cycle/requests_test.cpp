#include "core/cycle/requests.hpp"

#include <cmath>
#include <set>

#include <gtest/gtest.h>

#include "core/state/arm_mode_name.hpp"

// Texts of requests to arms, and of their answers.
namespace multipanda::requests_test {
namespace {

TEST(GripperRequests, AreRefusedForTheirFirstFault) {
  const double nan = std::nan("");
  EXPECT_EQ(check(GripperMove{0, 0.1}), "");
  EXPECT_EQ(check(GripperGrasp{0.04, 0.1, 40, 0, 0}), "");
  EXPECT_EQ(check(GripperMove{-0.01, 0.1}), "the width must be 0 or more meters");
  EXPECT_EQ(check(GripperMove{nan, -1}), "the width must be 0 or more meters");
  EXPECT_EQ(check(GripperMove{0.02, 0}), "the speed must be above 0 m/s");
  EXPECT_EQ(check(GripperGrasp{0.02, nan, 40}), "the speed must be above 0 m/s");
  EXPECT_EQ(check(GripperGrasp{0.02, 0.1, 0}), "the force must be above 0 N");
  EXPECT_EQ(check(GripperGrasp{0.02, 0.1, INFINITY}), "the force must be above 0 N");
  EXPECT_EQ(check(GripperGrasp{0.02, 0.1, 40, -0.001, 0}), "the tolerances must be 0 or more meters");
  EXPECT_EQ(check(GripperGrasp{0.02, 0.1, 40, 0, nan}), "the tolerances must be 0 or more meters");
}

TEST(ArmWords, EveryModeHasItsOwnName) {
  std::set<std::string_view> words;
  for (int mode = 0; mode <= static_cast<int>(ArmMode::disconnected); ++mode) {
    words.insert(to_string(static_cast<ArmMode>(mode)));
  }
  EXPECT_EQ(words.size(), 8u);
  EXPECT_FALSE(words.contains("unknown"));
  EXPECT_EQ(to_string(ArmMode::user_stopped), "user_stopped");
  EXPECT_EQ(to_string(static_cast<ArmMode>(8)), "unknown");
}

}  // namespace
}  // namespace multipanda::requests_test
