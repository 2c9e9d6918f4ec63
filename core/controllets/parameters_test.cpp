#include "core/controllets/parameters.hpp"

#include <limits>
#include <stdexcept>
#include <utility>

#include <gtest/gtest.h>

namespace multipanda::parameters_test {
namespace {

ParameterSet some() {
  return ParameterSet({{"gain", "", 1, {2}, 0, 10, ""},
                       {"per_joint", "", ParameterSpec::kPerJoint, {1, 2, 3, 4, 5, 6, 7, 8}, 0, 10, ""},
                       {"law", "", 1, {1}, 0, 2, "", {"a", "b", "c"}},
                       switch_parameter("flag", false, "")},
                      7);
}
std::array<double, 1> one(double v) { return {v}; }

TEST(Parameters, BoundsOfAnArmAreLowerThanTheSpecs) {
  ParameterSet set = some();
  set.lower_max(1, std::vector<double>{20, 1.5, 5, 5, 5, 5, -3}, "it bears no more");
  EXPECT_EQ(set.max(1, 0), 10);      // never raised
  EXPECT_EQ(set.max(1, 6), 0);       // nor below the lower bound
  EXPECT_EQ(set.values(1)[1], 1.5);  // the initial value was 2
  EXPECT_EQ(set.target(1), (std::vector<double>{1, 1.5, 3, 4, 5, 5, 0}));
  EXPECT_EQ(set.bound_reason(1), "it bears no more");
  EXPECT_EQ(set.bound_reason(0), "");
  EXPECT_EQ(set.check(1, std::vector<double>{10, 1.5, 5, 5, 5, 5, 0}), Verdict::accepted);
  EXPECT_EQ(set.check(1, std::vector<double>{10, 1.6, 5, 5, 5, 5, 0}), Verdict::out_of_bounds);
}

TEST(Parameters, RampLinearlyAndArriveExactly) {
  ParameterSet set = some();
  set.set(0, one(6));
  EXPECT_EQ(set.number(0), 2);
  EXPECT_EQ(set.target(0), std::vector<double>{6});
  const auto version = set.version();
  for (int k = 1; k < 200; ++k) {
    set.advance(0.001);
    ASSERT_NEAR(set.number(0), 2 + 4 * k / 200.0, 1e-12);
  }
  set.advance(0.001);
  set.advance(0.001);
  EXPECT_EQ(set.number(0), 6);
  EXPECT_GT(set.version(), version);
  const auto settled = set.version();
  set.advance(0.001);
  EXPECT_EQ(set.version(), settled);
}

TEST(Parameters, ANewGoalInTheMiddleOfARampMakesNoStep) {
  ParameterSet set = some();
  set.set(0, one(10));
  for (int k = 0; k < 100; ++k) set.advance(0.001);
  const double before = set.number(0);
  set.set(0, one(0));
  EXPECT_EQ(set.number(0), before);
  set.advance(0.001);
  EXPECT_NEAR(set.number(0), before - before / 200, 1e-12);
  set.finish();
  EXPECT_EQ(set.number(0), 0);
  set.set(0, one(4));
  set.set_now(0, one(3));
  set.advance(1);
  EXPECT_EQ(set.number(0), 3);
}

TEST(Parameters, ChoicesAndSwitchesChangeAtOnce) {
  ParameterSet set = some();
  set.set(2, one(2));
  EXPECT_EQ(set.choice(2), 2u);
  set.set(3, one(1));
  EXPECT_TRUE(set.flag(3));
}

TEST(Parameters, AreChecked) {
  const ParameterSet set = some();
  EXPECT_EQ(set.check(0, one(10)), Verdict::accepted);
  EXPECT_EQ(set.check(0, one(10.1)), Verdict::out_of_bounds);
  EXPECT_EQ(set.check(0, one(-0.1)), Verdict::out_of_bounds);
  EXPECT_EQ(set.check(0, one(std::nan(""))), Verdict::not_finite);
  EXPECT_EQ(set.check(0, one(std::numeric_limits<double>::infinity())), Verdict::not_finite);
  EXPECT_EQ(set.check(1, one(1)), Verdict::wrong_size);
  EXPECT_EQ(set.check(2, one(0.5)), Verdict::out_of_bounds);
  EXPECT_EQ(set.check(2, one(3)), Verdict::out_of_bounds);
  EXPECT_EQ(set.find("law"), 2u);
  EXPECT_EQ(set.find("low"), set.size());
}

TEST(Parameters, PerJointDefaultsAreCutToTheArm) {
  const ParameterSet set = some();
  EXPECT_EQ(set.value_size(1), 7u);
  EXPECT_EQ(set.joints(1).size(), 7);
  EXPECT_EQ(set.joints(1)[6], 7);
  EXPECT_THROW(ParameterSet({{"short", "", ParameterSpec::kPerJoint, {1, 2}, 0, 10, ""}}, 7),
               std::invalid_argument);
  EXPECT_THROW(ParameterSet({{"outside", "", 1, {11}, 0, 10, ""}}, 7), std::invalid_argument);
  EXPECT_THROW(ParameterSet({{"large", "", 17, {1}, 0, 10, ""}}, 7), std::invalid_argument);
}

// A law that caches what it derived from the values compares the version, which changes whenever they do.
TEST(Parameters, TheVersionChangesWithEveryChangeAndOnlyThen) {
  ParameterSet set = some();
  auto version = set.version();
  const auto changed = [&] { return std::exchange(version, set.version()) != set.version(); };
  set.advance(0.001);
  set.finish();
  EXPECT_FALSE(changed());
  set.set_now(0, one(3));
  EXPECT_TRUE(changed());
  set.set(2, one(0));
  EXPECT_TRUE(changed());
  set.set(0, one(5));
  set.set(1, std::vector<double>(7, 0.5));
  for (int k = 0; k < 3; ++k) {
    set.advance(0.05);
    EXPECT_TRUE(changed());
  }
  set.set_now(0, one(4));  // ends its ramp, not the other
  EXPECT_TRUE(changed());
  set.advance(0.02);
  EXPECT_TRUE(changed());
  EXPECT_EQ(set.number(0), 4);
  EXPECT_NEAR(set.values(1)[6], 7 + (0.5 - 7) * 0.17 / 0.2, 1e-12);
  set.finish();
  EXPECT_TRUE(changed());
  EXPECT_EQ(set.values(1)[6], 0.5);
  for (int k = 0; k < 3; ++k) set.advance(0.05);
  EXPECT_FALSE(changed());
  set.set(0, one(2));  // a ramp that is set again still ends once
  set.set(0, one(1));
  set.finish();
  set.advance(1);
  set.set(0, one(9));
  set.advance(0.1);
  EXPECT_NEAR(set.number(0), 5, 1e-12);
  set.advance(0.1);
  set.advance(0.1);
  EXPECT_EQ(set.number(0), 9);
  EXPECT_EQ(set.target(1), std::vector<double>(7, 0.5));
}

TEST(Parameters, ABoundIsLoweredOnlyForTheNumbersThatExceedIt) {
  ParameterSet set = some();
  set.lower_max(0, one(10), "the same");
  EXPECT_EQ(set.bound_reason(0), "");
  set.lower_max(0, one(1), "less");
  EXPECT_EQ(set.number(0), 1);
  EXPECT_EQ(set.target(0), std::vector<double>{1});
  set.lower_max(1, std::vector<double>{9}, "the first");  // fewer bounds than numbers: the rest keep theirs
  EXPECT_EQ(set.max(1, 0), 9);
  EXPECT_EQ(set.max(1, 1), 10);
  EXPECT_EQ(set.values(1)[0], 1);
}

}  // namespace
}  // namespace multipanda::parameters_test
