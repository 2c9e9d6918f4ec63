#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/testing/test_files.hpp"
#include "sysid/comparison/compare.hpp"
#include "sysid/measured/testing/test_logs.hpp"

namespace multipanda::gate_test {
namespace {

using testing::HasSubstr;

class Gates : public testing::Test {
 protected:
  Gate gate(const std::string& text) {
    put_content(folder_ / "gate.yaml", text);
    return read_gate(folder_ / "gate.yaml");
  }
  std::string refusal(const std::string& text) {
    try {
      gate(text);
      return "";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  }
  // Joint 2 is 0.03 rad off, the others not at all: RMSE 0.01 in the mean of three.
  Comparison comparison_ = [] {
    MeasuredLog real = swinging_log(2.0, 3), sim = real;
    real.arm = "left";
    sim.q.col(1).array() += 0.03;
    return compare(std::span(&real, 1), std::span(&sim, 1));
  }();
  TestFolder folder_;
};

TEST_F(Gates, PassOrFailWithTheFigureThatDecides) {
  auto results = check_gate(gate("q: {rmse: 0.011, axis: 0.02, max: 0.031}\nlag_s: 0.001\n"), comparison_);
  ASSERT_EQ(results.size(), 4u);
  EXPECT_TRUE(results[0].held);
  EXPECT_FALSE(results[1].held);
  EXPECT_THAT(results[1].text,
              testing::AllOf(HasSubstr("left: q axis is 0.03 rad at joint 2, above 0.02 rad"),
                             HasSubstr("gate.yaml:1")));
  EXPECT_TRUE(results[2].held);
  EXPECT_TRUE(results[3].held);
}

TEST_F(Gates, MissingQuantitiesViolateThem) {
  const auto results = check_gate(gate("F_EE: {rmse: 5}\n"), comparison_);
  EXPECT_FALSE(results[0].held);
  EXPECT_THAT(results[0].text, HasSubstr("F_EE rmse cannot be judged: missing in both logs"));
}

TEST_F(Gates, AnArmsOwnLimitsReplaceTheCommonOnes) {
  const Gate both = gate("q: {rmse: 0.001, max: 1}\narms:\n  left: {q: {rmse: 0.02}}\n");
  const auto results = check_gate(both, comparison_);
  ASSERT_EQ(results.size(), 2u);
  EXPECT_TRUE(results[0].held && results[1].held);
  Comparison right = comparison_;
  right.arm = "right";
  EXPECT_FALSE(check_gate(both, right)[0].held);
}

TEST_F(Gates, AreRefusedWithFileAndLine) {
  EXPECT_THAT(refusal("q: {rmse: 1}\nforce: {rmse: 1}\n"),
              testing::AllOf(HasSubstr("gate.yaml:2"), HasSubstr("'force'")));
  EXPECT_THAT(refusal("F_E: {rmse: 1}\n"), HasSubstr("did you mean 'F_EE'"));
  EXPECT_THAT(refusal("q:\n  mean: 1\n"),
              testing::AllOf(HasSubstr("gate.yaml:2"), HasSubstr("rmse, axis or max")));
  EXPECT_THAT(refusal("q: {rmse: -1}\n"), HasSubstr("0 or more"));
  EXPECT_THAT(refusal("q: {rmse: much}\n"), HasSubstr("expected a number"));
  EXPECT_THAT(refusal("q: 1\n"), HasSubstr("{rmse: NUMBER}"));
  EXPECT_THAT(refusal("{}\n"), HasSubstr("no limit"));
  EXPECT_THAT(refusal("q: [\n"), HasSubstr("gate.yaml:"));
  EXPECT_THROW(read_gate(folder_ / "none.yaml"), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::gate_test
