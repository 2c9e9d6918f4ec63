#include "tests/collision/approach.hpp"

#include <gtest/gtest.h>

#include "core/testing/series.hpp"

namespace multipanda::approach::approach_test {
namespace {

// An approach that touches without collision avoidance keeps its distance with it. Approaches that would not
// touch are drawn again. All 50 run with --full, otherwise a tenth, one of each kind.
TEST(Approaches, KeepTheirDistance) {
  test::Series series;
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    if (!series.takes(seed < kKinds)) continue;
    Outcome without;
    const Approach approach = draw_touching(seed, without);
    SCOPED_TRACE(std::string(to_string(approach.kind)) + ", seed " + std::to_string(seed));
    EXPECT_LE(without.clearance, 0.001);
    EXPECT_NEAR(without.speed, approach.speed, 0.1);

    const Outcome with = run(approach, true);
    series.record("clearance_m", with.clearance);
    series.record("torque_share", with.torque_share);
    EXPECT_GE(with.clearance, 0.005);
    EXPECT_FALSE(with.touched);
    EXPECT_NEAR(with.speed, approach.speed, 0.1);
    EXPECT_LE(with.torque_share, 1) << "requested torque over its limit";
    EXPECT_EQ(with.torque_cut, 0u);
    EXPECT_EQ(with.taken_out, "");
  }
}

// The same with the bounds that a scene has unless it lifts them: set-points wait, and the pull is bounded.
TEST(BoundedApproaches, KeepTheirDistance) {
  test::Series series;
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    if (!series.takes(seed < kKinds)) continue;
    Outcome lifted;
    Approach approach = draw_touching(seed, lifted);
    approach.scene.contact_bounds = ContactBounds();
    for (auto& law : approach.scene.controllets) law.contact = ContactBounds();
    approach.duration_s *= 5;  // 0.25 m/s
    const Outcome without = run(approach, false);
    EXPECT_LE(without.clearance, 0.001) << to_string(approach.kind);  // the feature keeps it
    const Outcome with = run(approach, true);
    series.record("clearance_m", with.clearance);
    EXPECT_GE(with.clearance, 0.005) << to_string(approach.kind);
    EXPECT_FALSE(with.touched);
    EXPECT_LT(with.speed, 0.6);  // two hands
    EXPECT_EQ(with.torque_cut, 0u);
    EXPECT_EQ(with.taken_out, "") << to_string(approach.kind);
  }
}

}  // namespace
}  // namespace multipanda::approach::approach_test
