#include "tests/collision/quiet.hpp"

#include <gtest/gtest.h>

#include "core/testing/series.hpp"

namespace multipanda::quiet::quiet_test {
namespace {

// Collision avoidance with its defaults lets a hand come to rest where its force and the law's balance: the
// limits of torque and rate never act, and nothing swings by a millimeter. All 200 goals run with --full,
// otherwise a tenth.
TEST(Quiet, GoalsWithinTheRange) {
  test::Series series;
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    if (!series.takes(seed % 7 == 0 && seed < 140)) continue;  // all places, plants, robots and tilts
    const Goal goal = draw(seed);
    const Outcome outcome = run(goal);
    EXPECT_LT(outcome.swing, 1e-3) << seed << " " << goal.name;
    EXPECT_EQ(outcome.interventions, 0u) << seed << " " << goal.name << ": " << outcome.first;
    series.record("swing_m", outcome.swing);
    series.record("offset_m", outcome.offset);
    series.record("pushed", outcome.force > 0.5);
  }
  if (series.whole()) {  // the goals are where the feature acts
    EXPECT_GT(series.sum("pushed"), 2 * static_cast<double>(series.size()) / 3);
  }
}

}  // namespace
}  // namespace multipanda::quiet::quiet_test
