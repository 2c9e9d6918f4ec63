#include "runtime/live_input/stream_packet.hpp"

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::stream_packet_test {
namespace {

TEST(StreamPacketTest, HasTheDocumentedLayout) {
  StreamPacket packet{.channel = 0x01020304, .sequence = 5, .client_time_ns = -2, .count = 2, .values = {}};
  packet.values[0] = 1.0;
  packet.values[1] = -2.0;
  StreamPacketBytes bytes{};
  ASSERT_EQ(pack(packet, bytes), 48u);
  const std::vector<std::uint8_t> expected{
      'M',  'P',  'R',  'S',  1,    0,    2,    0,      // magic, version, count
      4,    3,    2,    1,    0,    0,    0,    0,      // channel, nothing
      5,    0,    0,    0,    0,    0,    0,    0,      // sequence
      0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF,   // -2
      0,    0,    0,    0,    0,    0,    0xF0, 0x3F,   // 1.0
      0,    0,    0,    0,    0,    0,    0x00, 0xC0};  // -2.0
  EXPECT_EQ(std::vector<std::uint8_t>(bytes.begin(), bytes.begin() + 48), expected);
  const auto back = unpack(std::span(bytes).first(48));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->channel, packet.channel);
  EXPECT_EQ(back->sequence, 5u);
  EXPECT_EQ(back->client_time_ns, -2);
  EXPECT_EQ(back->values, packet.values);
}

TEST(StreamPacketTest, OfAChunkHasTheDocumentedLayout) {
  ChunkPacket packet;
  packet.head.channel = 7;
  packet.head.sequence = 9;
  packet.chunk.size = 2;
  packet.chunk.count = 3;
  for (std::size_t k = 0; k < 3; ++k) {
    packet.chunk.times_s[k] = 1.0 + static_cast<double>(k);
    packet.chunk.values[k] = {10.0 + static_cast<double>(k), 20.0 + static_cast<double>(k)};
  }
  ChunkPacketBytes bytes{};
  ASSERT_EQ(pack(packet, bytes), 32u + 8u * 9u);
  EXPECT_EQ(bytes[4], 2);   // version
  EXPECT_EQ(bytes[6], 2);   // values per sample
  EXPECT_EQ(bytes[12], 3);  // samples
  std::array<double, 9> numbers{};
  std::memcpy(numbers.data(), bytes.data() + 32, sizeof(numbers));  // on a little-endian machine
  EXPECT_EQ(numbers, (std::array<double, 9>{1, 2, 3, 10, 20, 11, 21, 12, 22}));
  const std::span<const std::uint8_t> whole = std::span(bytes).first(32 + 8 * 9);
  const auto back = unpack_chunk(whole);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->head.channel, 7u);
  EXPECT_EQ(back->head.sequence, 9u);
  EXPECT_EQ(back->chunk.times_s, packet.chunk.times_s);
  EXPECT_EQ(back->chunk.values, packet.chunk.values);
  EXPECT_FALSE(unpack(whole));  // a sample it is not
  for (std::size_t cut = 0; cut < whole.size(); ++cut) EXPECT_FALSE(unpack_chunk(whole.first(cut))) << cut;
  EXPECT_FALSE(unpack_chunk(std::span(bytes).first(whole.size() + 1)));
  for (const std::size_t at : {0u, 4u, 6u, 12u, 13u, 15u}) {
    ChunkPacketBytes wrong = bytes;
    wrong[at] = static_cast<std::uint8_t>(wrong[at] ^ 0x40);
    EXPECT_FALSE(unpack_chunk(std::span(wrong).first(whole.size()))) << at;
  }
  bytes[12] = 0;
  EXPECT_FALSE(unpack_chunk(std::span(bytes).first(32)));
}

TEST(StreamPacketTest, InvalidPacketsAreRefused) {
  StreamPacketBytes bytes{};
  const std::size_t size =
      pack({.channel = 1, .sequence = 1, .client_time_ns = 0, .count = 7, .values = {}}, bytes);
  ASSERT_TRUE(unpack(std::span(bytes).first(size)));
  for (std::size_t cut = 0; cut < size; ++cut) EXPECT_FALSE(unpack(std::span(bytes).first(cut))) << cut;
  EXPECT_FALSE(unpack(std::span(bytes).first(size + 1)));
  for (const std::size_t at : {0u, 3u, 4u, 5u, 6u, 7u}) {
    StreamPacketBytes wrong = bytes;
    wrong[at] = static_cast<std::uint8_t>(wrong[at] ^ 0x40);
    EXPECT_FALSE(unpack(std::span(wrong).first(size))) << at;
  }
  std::mt19937 random(7);
  for (int n = 0; n < 20000; ++n) {  // any input: no crash, and nothing is accepted without the magic
    StreamPacketBytes noise;
    for (auto& byte : noise) byte = static_cast<std::uint8_t>(random());
    const auto part = std::span(noise).first(random() % noise.size());
    EXPECT_FALSE(unpack(part));
    EXPECT_FALSE(unpack_chunk(part));
  }
}

}  // namespace
}  // namespace multipanda::stream_packet_test
