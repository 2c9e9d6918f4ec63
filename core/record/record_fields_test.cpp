#include "core/record/record_fields.hpp"

#include <bit>
#include <cmath>

#include <gtest/gtest.h>

#include "core/testing/drawn_sample.hpp"

// Every quantity of an arm, by the walk over the table of arm_sample.hpp.
namespace multipanda::record_fields_test {
namespace {

// The number at a place of a record, by its type.
double number_at(const std::vector<std::uint64_t>& row, const RecordField& field, std::size_t k) {
  const std::uint64_t bits = row[field.offset / 8 + k];
  if (field.type == 'f') return std::bit_cast<double>(bits);
  return field.type == 'i' ? static_cast<double>(std::bit_cast<std::int64_t>(bits))
                           : static_cast<double>(bits);
}

class EveryQuantity : public testing::TestWithParam<std::size_t> {};  // joints

TEST_P(EveryQuantity, IsInItsPlaceOfARecord) {
  std::mt19937_64 random(GetParam());
  for (const bool reports : {true, true, false}) {
    const test::DrawnSample drawn = test::draw_sample(random, GetParam(), reports);
    FieldList list(0);
    visit_sample(list, drawn.sample, GetParam());
    ASSERT_EQ(list.fields().size(), drawn.numbers.size());
    std::vector<std::uint64_t> row(list.offset() / 8);
    FieldWriter writer(reinterpret_cast<std::byte*>(row.data()));
    visit_sample(writer, drawn.sample, GetParam());
    std::vector<double> all(row.size());
    NumberWriter numbers(all.data());
    visit_sample(numbers, drawn.sample, GetParam());
    for (const RecordField& field : list.fields()) {
      const std::vector<double>& expected = drawn.numbers.at(field.name);
      ASSERT_EQ(field.count, expected.size()) << field.name;
      // Lists of numbers that the arm does not report are not numbers; what stands alone keeps its value.
      const bool listed = field.type == 'f' && field.count > 1;
      const bool unknown = listed && !reports && drawn.known.at(field.name) != "always";
      for (std::size_t k = 0; k < field.count; ++k) {
        const double found = number_at(row, field, k), other = all[field.offset / 8 + k];
        EXPECT_TRUE(found == other || (std::isnan(found) && std::isnan(other))) << field.name;
        EXPECT_EQ(std::isnan(found), unknown) << field.name;
        if (unknown) continue;
        EXPECT_NEAR(found, expected[k], 1e-14) << field.name;  // a rotation's quaternion rounds
      }
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Joints, EveryQuantity, testing::Values(2, 7, kMaxJoints));

TEST(RecordFields, AnArmOfOneJointHasListsOfOne) {
  FieldList list(16);
  visit_sample(list, ArmSample{}, 1);
  const auto q = std::ranges::find(list.fields(), "q_rad", &RecordField::name);
  ASSERT_NE(q, list.fields().end());
  EXPECT_EQ(q->count, 1u);
  EXPECT_EQ(list.fields().front().offset, 16u);
  EXPECT_EQ(count_of<JointFlags>(1), 1u);
  EXPECT_EQ(count_of<PoseArray>(1), 7u);
}

}  // namespace
}  // namespace multipanda::record_fields_test
