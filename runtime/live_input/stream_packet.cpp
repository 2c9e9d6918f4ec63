#include "runtime/live_input/stream_packet.hpp"

#include <algorithm>
#include <bit>
#include <concepts>
#include <cstring>
#include <ctime>
#include <sys/socket.h>

namespace multipanda {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'M', 'P', 'R', 'S'};
constexpr std::uint16_t kVersion = 1, kChunkVersion = 2;

// Byte by byte, independent of the machine's byte order and alignment.
template <std::unsigned_integral T>
void put(std::span<std::uint8_t> bytes, std::size_t offset, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    bytes[offset + i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
  }
}

template <std::unsigned_integral T>
T get(std::span<const std::uint8_t> bytes, std::size_t offset) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{bytes[offset + i]} << (8 * i);
  return static_cast<T>(value);
}

void put_head(const StreamPacket& packet, std::uint16_t version, std::uint32_t samples,
              std::span<std::uint8_t> bytes) {
  for (std::size_t i = 0; i < kMagic.size(); ++i) bytes[i] = kMagic[i];
  put<std::uint16_t>(bytes, 4, version);
  put<std::uint16_t>(bytes, 6, packet.count);
  put<std::uint32_t>(bytes, 8, packet.channel);
  put<std::uint32_t>(bytes, 12, samples);
  put<std::uint64_t>(bytes, 16, packet.sequence);
  put<std::uint64_t>(bytes, 24, std::bit_cast<std::uint64_t>(packet.client_time_ns));
}

void put_number(double value, std::size_t n, std::span<std::uint8_t> bytes) {
  put<std::uint64_t>(bytes, kStreamHeaderBytes + 8 * n, std::bit_cast<std::uint64_t>(value));
}

// The n-th number behind the header.
double number(std::span<const std::uint8_t> bytes, std::size_t n) {
  return std::bit_cast<double>(get<std::uint64_t>(bytes, kStreamHeaderBytes + 8 * n));
}

// The header of a packet of this version with a possible count of values.
std::optional<StreamPacket> unpack_head(std::span<const std::uint8_t> bytes, std::uint16_t version) {
  if (bytes.size() < kStreamHeaderBytes) return {};
  for (std::size_t i = 0; i < kMagic.size(); ++i) {
    if (bytes[i] != kMagic[i]) return {};
  }
  StreamPacket packet;
  packet.count = get<std::uint16_t>(bytes, 6);
  if (get<std::uint16_t>(bytes, 4) != version || packet.count == 0 || packet.count > kMaxTargetValues)
    return {};
  packet.channel = get<std::uint32_t>(bytes, 8);
  packet.sequence = get<std::uint64_t>(bytes, 16);
  packet.client_time_ns = std::bit_cast<std::int64_t>(get<std::uint64_t>(bytes, 24));
  return packet;
}

}  // namespace

std::size_t pack(const StreamPacket& packet, StreamPacketBytes& bytes) {
  put_head(packet, kVersion, 0, bytes);
  std::size_t next = 0;
  for (std::size_t i = 0; i < packet.count; ++i) put_number(packet.values[i], next++, bytes);
  return kStreamHeaderBytes + 8 * next;
}

std::size_t pack(const ChunkPacket& packet, ChunkPacketBytes& bytes) {
  const Chunk& chunk = packet.chunk;
  StreamPacket head = packet.head;
  head.count = chunk.size;
  put_head(head, kChunkVersion, chunk.count, bytes);
  std::size_t next = 0;
  for (std::size_t k = 0; k < chunk.count; ++k) put_number(chunk.times_s[k], next++, bytes);
  for (std::size_t k = 0; k < chunk.count; ++k) {
    for (std::size_t i = 0; i < chunk.size; ++i) put_number(chunk.values[k][i], next++, bytes);
  }
  return kStreamHeaderBytes + 8 * next;
}

std::optional<StreamPacket> unpack(std::span<const std::uint8_t> bytes) {
  auto packet = unpack_head(bytes, kVersion);
  if (!packet || bytes.size() != kStreamHeaderBytes + 8 * std::size_t{packet->count}) return {};
  for (std::size_t i = 0; i < packet->count; ++i) packet->values[i] = number(bytes, i);
  return packet;
}

std::optional<ChunkPacket> unpack_chunk(std::span<const std::uint8_t> bytes) {
  const auto head = unpack_head(bytes, kChunkVersion);
  if (!head) return {};
  const auto samples = get<std::uint32_t>(bytes, 12);
  if (samples == 0 || samples > Chunk::kMostSamples ||
      bytes.size() != kStreamHeaderBytes + 8 * std::size_t{samples} * (1u + head->count)) {
    return {};
  }
  ChunkPacket packet{.head = *head, .chunk = {}};
  packet.chunk.size = static_cast<std::uint8_t>(head->count);
  packet.chunk.count = static_cast<std::uint8_t>(samples);
  std::size_t next = 0;
  for (std::size_t k = 0; k < samples; ++k) packet.chunk.times_s[k] = number(bytes, next++);
  for (std::size_t k = 0; k < samples; ++k) {
    for (std::size_t i = 0; i < head->count; ++i) packet.chunk.values[k][i] = number(bytes, next++);
  }
  return packet;
}

void note_sending_times(int file) {
  const int on = 1;
  (void)setsockopt(file, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof(on));
}

std::ptrdiff_t receive_packet(int file, std::span<std::uint8_t> bytes, double now_s, double& age_s) {
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec))> notes{};
  iovec content{bytes.data(), bytes.size()};
  msghdr message{};
  message.msg_iov = &content;
  message.msg_iovlen = 1;
  message.msg_control = notes.data();
  message.msg_controllen = notes.size();
  age_s = 0;
  const ssize_t size = recvmsg(file, &message, MSG_DONTWAIT | MSG_TRUNC);
  if (size <= 0) return size;
  for (cmsghdr* note = CMSG_FIRSTHDR(&message); note != nullptr; note = CMSG_NXTHDR(&message, note)) {
    if (note->cmsg_level != SOL_SOCKET || note->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec sent{};
    std::memcpy(&sent, CMSG_DATA(note), sizeof(sent));
    const double sent_s = static_cast<double>(sent.tv_sec) + 1e-9 * static_cast<double>(sent.tv_nsec);
    age_s = std::max(0.0, now_s - sent_s);
  }
  return size;
}

double realtime_s() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace multipanda
