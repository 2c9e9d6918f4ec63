#include "tests/collision/quiet.hpp"

#include <gtest/gtest.h>

#include "core/testing/full_series.hpp"

namespace multipanda::quiet::quiet_test {
namespace {

// Collision avoidance with its defaults lets a hand come to rest where its force and the law's balance: the
// limits of torque and rate never act, and nothing swings by a millimeter. All 200 goals run with --full,
// otherwise a tenth.
TEST(Quiet, GoalsWithinTheRange) {
  const bool full = test::full_series();
  constexpr std::uint32_t kGoals = 200;
  int pushed = 0, count = 0;
  for (std::uint32_t k = 0; k < (full ? kGoals : kGoals / 10); ++k) {
    const std::uint32_t seed = full ? k : 7 * k;  // all places, plants, robots and tilts
    const Goal goal = draw(seed);
    const Outcome outcome = run(goal);
    EXPECT_LT(outcome.swing, 1e-3) << seed << " " << goal.name;
    EXPECT_EQ(outcome.interventions, 0u) << seed << " " << goal.name << ": " << outcome.first;
    pushed += outcome.force > 0.5;
    ++count;
  }
  EXPECT_GT(pushed, 2 * count / 3);  // the goals are where the feature acts
}

}  // namespace
}  // namespace multipanda::quiet::quiet_test
