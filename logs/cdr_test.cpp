#include "logs/cdr.hpp"

#include <random>

#include <gtest/gtest.h>

#include "logs/messages.hpp"
#include "logs/testing/test_messages.hpp"

namespace multipanda::cdr_test {
namespace {

std::vector<std::uint8_t> serialized(const auto& message) {
  CdrWriter writer;
  const auto bytes = writer.write(message);
  return {bytes.begin(), bytes.end()};
}

// Bytes computed by hand from the format's rules.
TEST(Cdr, LayoutOfStringsAndAlignment) {
  msg::ControlletOutput message;
  message.stamp.sec = 1;
  message.stamp.nanosec = 2;
  message.cycle = 3;
  message.instance = "ab";
  message.name = "";
  message.values = {1.0};
  const std::vector<std::uint8_t> expected = {0, 1, 0, 0,                     // little-endian CDR
                                              1, 0, 0, 0, 2,   0,   0,    0,  // stamp, at 0 and 4
                                              3, 0, 0, 0, 0,   0,   0,    0,  // cycle, at 8
                                              3, 0, 0, 0, 'a', 'b', 0,        // at 16: length with NUL
                                              0,                              // fill up to 24
                                              1, 0, 0, 0, 0,                  // at 24: empty text is one NUL
                                              0, 0, 0,                        // fill up to 32
                                              1, 0, 0, 0,                     // at 32: one element
                                              0, 0, 0, 0,                     // fill up to 40
                                              0, 0, 0, 0, 0,   0,   0xF0, 0x3F};
  EXPECT_EQ(serialized(message), expected);
}

TEST(Cdr, EmptySequenceOfDoublesIsNotAligned) {
  msg::ControlletOutput message;
  // 4 header, 8 stamp, 8 cycle, 5 + 3 instance, 5 + 3 name, 4 count. An empty sequence has no alignment.
  EXPECT_EQ(serialized(message).size(), 4u + 8 + 8 + 8 + 8 + 4);
}

template <typename M>
class EveryMessage : public testing::Test {};

template <typename Tuple>
struct AsTypes;
template <typename... M>
struct AsTypes<std::tuple<M...>> {
  using Types = testing::Types<M...>;
};
TYPED_TEST_SUITE(EveryMessage, AsTypes<msg::OwnMessages>::Types);

TYPED_TEST(EveryMessage, RoundTrip) {
  std::mt19937 random(7);
  for (int i = 0; i < 50; ++i) {
    TypeParam message;
    RandomFiller(random).fill(message);
    const auto bytes = serialized(message);
    TypeParam back;
    RandomFiller(random).fill(back);  // earlier content must not remain
    CdrReader(bytes).read(back);
    EXPECT_EQ(message.fields(), back.fields());
  }
}

// A damaged message is refused, whatever is damaged, and nothing outside its bytes is read (sanitizers).
TYPED_TEST(EveryMessage, CutOffIsRefused) {
  std::mt19937 random(8);
  TypeParam message;
  RandomFiller(random).fill(message);
  const auto bytes = serialized(message);
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_THROW((void)from_cdr<TypeParam>(std::span(bytes).first(size)), std::runtime_error) << size;
  }
}

TYPED_TEST(EveryMessage, DamagedBytesDoNoHarm) {
  std::mt19937 random(9);
  TypeParam message;
  RandomFiller(random).fill(message);
  auto bytes = serialized(message);
  for (int i = 0; i < 2000; ++i) {
    auto damaged = bytes;
    damaged[random() % damaged.size()] = static_cast<std::uint8_t>(random());
    try {
      (void)from_cdr<TypeParam>(damaged);
    } catch (const std::runtime_error&) {
    }
  }
}

}  // namespace
}  // namespace multipanda::cdr_test
