// Malformed input. Seeded; a tenth of the cases unless MULTIPANDA_FULL is set.
#include <cstring>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "core/testing/full_series.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"
#include "fci/wire/testing/fuzz_input.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci::hostile_bytes_test {
namespace {

using Bytes = std::vector<std::byte>;

int cases(int full) { return multipanda::test::full_series() ? full : full / 10; }

template <class R>
void append(Bytes& stream, const Dialect& d, const R& request) {
  std::array<std::byte, kMaxRequestSize> one{};
  const std::size_t size = encode_request(d, 1, request, one);
  stream.insert(stream.end(), one.begin(), one.begin() + static_cast<std::ptrdiff_t>(size));
}

// Valid input: the two bytes of `survives`, then a few requests or one datagram.
std::vector<Bytes> well_meant() {
  std::vector<Bytes> seeds;
  for (std::size_t i = 0; i < kDialects.size(); ++i) {
    const Dialect& d = kDialects[i];
    Bytes stream{static_cast<std::byte>(i), std::byte{60}};
    const Bytes head = stream;
    append(stream, d, ConnectRequest{});
    append(stream, d, MoveRequest{MoveController::joint_impedance, MoveGenerator::joint_position});
    append(stream, d, SetGuidingModeRequest{});
    append(stream, d, LoadModelLibraryRequest{});
    append(stream, d, StopMoveRequest{});
    seeds.push_back(stream);
    stream = head;
    append(stream, d, SetCollisionBehaviorRequest{});
    seeds.push_back(stream);
    stream = head;
    stream.resize(2 + command_size(d));
    encode(d, RobotCommand{}, std::span(stream).subspan(2));
    seeds.push_back(stream);
    stream = head;
    stream.resize(2 + state_size(d));
    encode(d, RobotState{}, std::span(stream).subspan(2));
    seeds.push_back(stream);
  }
  Bytes gripper{std::byte{200}, std::byte{9}};
  gripper.resize(2 + 50 + 26 + 20);
  encode_gripper_request(0, GripperGraspRequest{}, std::span(gripper).subspan(2));
  encode_gripper_request(1, GripperMoveRequest{}, std::span(gripper).subspan(52));
  encode_gripper_request(2, VacuumRequest{}, std::span(gripper).subspan(78));
  seeds.push_back(gripper);
  return seeds;
}

// Bits, lengths and numbers changed, pieces cut out or repeated.
void spoil(Bytes& bytes, std::mt19937& random) {
  const auto below = [&](std::size_t n) {
    return static_cast<std::size_t>(random()) % std::max<std::size_t>(n, 1);
  };
  for (std::size_t changes = 1 + below(4); changes > 0 && bytes.size() > 2; --changes) {
    const std::size_t at = below(bytes.size());
    switch (below(5)) {
      case 0:
        bytes[at] ^= std::byte{1} << static_cast<int>(below(8));
        break;
      case 1:
        bytes[at] = static_cast<std::byte>(random());
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3: {  // an extreme number
        const std::uint32_t values[] = {0,   1,          11,         12,         428,
                                        429, 0x7fffffff, 0x80000000, 0xffffffff, 0x7ff80000};
        const std::uint32_t value = values[below(std::size(values))];
        if (at + sizeof value <= bytes.size()) std::memcpy(bytes.data() + at, &value, sizeof value);
        break;
      }
      default: {
        const Bytes piece(
            bytes.begin() + static_cast<std::ptrdiff_t>(at),
            bytes.begin() + static_cast<std::ptrdiff_t>(std::min(bytes.size(), at + below(60))));
        bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), piece.begin(), piece.end());
      }
    }
  }
}

TEST(HostileBytes, SpoiledMessages) {
  const std::vector<Bytes> seeds = well_meant();
  for (const Bytes& seed : seeds) ASSERT_TRUE(survives(seed)) << "before anything is spoiled";
  std::mt19937 random(20);
  Bytes bytes;
  for (int i = 0; i < cases(800000); ++i) {
    bytes = seeds[random() % seeds.size()];
    spoil(bytes, random);
    ASSERT_TRUE(survives(bytes)) << "case " << i;
  }
}

TEST(HostileBytes, Noise) {
  std::mt19937 random(21);
  Bytes bytes;
  for (int i = 0; i < cases(200000); ++i) {
    bytes.resize(random() % 600);
    for (std::byte& b : bytes) b = static_cast<std::byte>(random() >> 7);
    ASSERT_TRUE(survives(bytes)) << "case " << i;
  }
}

// A stream gives the same messages, however it is split.
TEST(HostileBytes, EveryCutGivesTheSameMessages) {
  const Dialect& d = *dialect(10);
  Bytes stream;
  append(stream, d, SetLoadRequest{2, {}, {}});
  append(stream, d, StopMoveRequest{});
  append(stream, d, SetCollisionBehaviorRequest{});
  append(stream, d, GetRobotModelRequest{});
  for (std::size_t chunk = 1; chunk <= stream.size(); ++chunk) {
    FrameReader reader(HeaderKind::arm, kMaxRequestSize, 24);
    std::vector<std::pair<std::uint32_t, std::size_t>> got;
    for (std::size_t at = 0; at < stream.size();) {
      const auto room = reader.room();
      ASSERT_FALSE(room.empty());
      const std::size_t n = std::min({chunk, room.size(), stream.size() - at});
      std::memcpy(room.data(), stream.data() + at, n);
      reader.received(n);
      at += n;
      Message message;
      while (reader.next(message) == FrameReader::Next::message)
        got.emplace_back(message.command, message.payload.size());
    }
    const std::vector<std::pair<std::uint32_t, std::size_t>> expected{{9, 104}, {2, 0}, {3, 416}, {11, 0}};
    EXPECT_EQ(got, expected) << chunk;
  }
}

// A header's claimed size allocates no memory, and an invalid one stops the stream permanently.
TEST(HostileBytes, ClaimsTakeNoMemory) {
  for (const std::uint32_t size : {0u, 11u, 429u, 0x7fffffffu, 0xffffffffu}) {
    FrameReader reader(HeaderKind::arm, kMaxRequestSize);
    std::array<std::byte, 12> header{};
    encode(HeaderKind::arm, {1, 1, size}, header);
    std::memcpy(reader.room().data(), header.data(), header.size());
    reader.received(header.size());
    Message message;
    EXPECT_EQ(reader.next(message), FrameReader::Next::bad_size) << size;
    EXPECT_EQ(reader.next(message), FrameReader::Next::bad_size) << size;
    reader.reset();
    EXPECT_EQ(reader.next(message), FrameReader::Next::incomplete);
  }
  FrameReader large(HeaderKind::arm, 64 << 20, 64);
  std::array<std::byte, 12> header{};
  encode(HeaderKind::arm, {1, 1, 64 << 20}, header);
  std::memcpy(large.room().data(), header.data(), header.size());
  large.received(header.size());
  Message message;
  EXPECT_EQ(large.next(message), FrameReader::Next::incomplete);
  EXPECT_LT(large.room().size(), 1000u);
  EXPECT_THROW(FrameReader(HeaderKind::arm, 11), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::fci::hostile_bytes_test
