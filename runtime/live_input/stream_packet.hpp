#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "core/reference/target.hpp"
#include "core/types/capacity.hpp"

// The binary reference stream (docs/live_input.md): one packet per set-point, little-endian throughout.
//
//   offset  type     field
//        0  4 bytes  "MPRS"
//        4  u16      version, 1
//        6  u16      count of values, 1 to kMaxTargetValues
//        8  u32      channel from the answer of the handshake
//       12  u32      0
//       16  u64      sequence number of this channel, increasing; gaps count as lost
//       24  i64      the publisher's own time [ns], any clock
//       32  f64[]    values, in the order of Target
//
// Version 2 is a chunk: samples that are not due yet. The number at 12 is that of its samples, 1 to 64. At 32
// come their times [s], of the loop, then the values of the first sample, of the second one, and so on.
namespace multipanda {

struct StreamPacket {
  std::uint32_t channel = 0;
  std::uint64_t sequence = 0;
  std::int64_t client_time_ns = 0;
  std::uint16_t count = 0;
  std::array<double, kMaxTargetValues> values{};
};

struct ChunkPacket {
  StreamPacket head;  // without values
  Chunk chunk;
};

inline constexpr std::size_t kStreamHeaderBytes = 32;
inline constexpr std::size_t kStreamPacketBytes = kStreamHeaderBytes + 8 * kMaxTargetValues;
inline constexpr std::size_t kChunkPacketBytes =
    kStreamHeaderBytes + 8 * (1 + kMaxTargetValues) * Chunk::kMostSamples;
using StreamPacketBytes = std::array<std::uint8_t, kStreamPacketBytes>;
using ChunkPacketBytes = std::array<std::uint8_t, kChunkPacketBytes>;

// Returns the number of bytes used.
std::size_t pack(const StreamPacket& packet, StreamPacketBytes& bytes);
std::size_t pack(const ChunkPacket& packet, ChunkPacketBytes& bytes);
// None if the packet is of another version or incomplete.
std::optional<StreamPacket> unpack(std::span<const std::uint8_t> bytes);
std::optional<ChunkPacket> unpack_chunk(std::span<const std::uint8_t> bytes);

// A packet may wait in the socket while this computer is overloaded; the kernel notes when it was sent.
void note_sending_times(int file);
// The next packet, without waiting: its size, cut to that of `bytes`, or 0 for a closed socket, or -1
// (errno). `age_s`: since it was sent; 0 if unknown. `now_s`: by realtime_s().
std::ptrdiff_t receive_packet(int file, std::span<std::uint8_t> bytes, double now_s, double& age_s);
// The clock of those times [s].
double realtime_s();

}  // namespace multipanda
