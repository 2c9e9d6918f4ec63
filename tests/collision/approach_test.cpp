#include "tests/collision/approach.hpp"

#include <cstdlib>

#include <gtest/gtest.h>

namespace multipanda::approach::approach_test {
namespace {

// An approach that touches without collision avoidance keeps its distance with it. Approaches that would not
// touch are drawn again. All 50 run with --full, otherwise a tenth, one of each kind.
class Approaches : public testing::TestWithParam<std::uint32_t> {};

TEST_P(Approaches, KeepTheirDistance) {
  const std::uint32_t seed = GetParam();
  if (seed >= kKinds && std::getenv("MULTIPANDA_FULL") == nullptr)
    GTEST_SKIP() << "one of 45 more with --full";
  Outcome without;
  const Approach approach = draw_touching(seed, without);
  EXPECT_LE(without.clearance, 0.001);
  EXPECT_NEAR(without.speed, approach.speed, 0.1);

  const Outcome with = run(approach, true);
  EXPECT_GE(with.clearance, 0.005) << to_string(approach.kind);
  EXPECT_FALSE(with.touched);
  EXPECT_NEAR(with.speed, approach.speed, 0.1);
  EXPECT_LE(with.torque_share, 1) << "requested torque over its limit";
  EXPECT_EQ(with.torque_cut, 0u);
  EXPECT_EQ(with.taken_out, "");
}
INSTANTIATE_TEST_SUITE_P(Seeds, Approaches, testing::Range(0u, 50u));

}  // namespace
}  // namespace multipanda::approach::approach_test
