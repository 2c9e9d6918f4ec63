#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <span>
#include <string>

#include "core/types/time.hpp"

namespace multipanda::fci {

// Network faults, the same in both directions. All zero: none.
struct DatagramFaults {
  double latency_s = 0;  // of every datagram
  double jitter_s = 0;   // additional delay, uniform from 0 to this
  double loss = 0;       // fraction of datagrams that are lost
  double duplicate = 0;  // fraction that arrives twice
  double reorder = 0;    // fraction that is overtaken by the next one

  bool any() const { return latency_s > 0 || jitter_s > 0 || loss > 0 || duplicate > 0 || reorder > 0; }
};

// Why `faults` are invalid, or an empty string.
std::string check(const DatagramFaults& faults);

// One direction of a bad network. The same seed drops and delays the same datagrams. No allocation.
class FaultyLine {
 public:
  explicit FaultyLine(std::uint64_t seed) : random_(seed) {}

  void set(const DatagramFaults& faults) { faults_ = faults; }
  const DatagramFaults& faults() const { return faults_; }
  bool is_clear() const { return !faults_.any() && waiting_ == 0; }

  struct Fate {
    bool lost = false, duplicated = false, overtaken = false;
    std::chrono::nanoseconds delay{0};
  };
  Fate draw();  // faults of the next datagram

  // Adds a datagram at `now`. False: lost, also if the buffer is full.
  bool put(std::span<const std::byte> datagram, HostTime now);
  // Calls deliver(datagram) for the datagrams due at `now`, the earliest first.
  template <typename Deliver>
  void deliver(HostTime now, Deliver deliver) {
    while (const Slot* slot = earliest(now)) {
      deliver(std::span<const std::byte>(slot->bytes.data(), slot->size));
      release(*slot);
    }
  }
  std::optional<HostTime> next_due() const;
  void clear();  // drops all datagrams in transit

 private:
  static constexpr std::size_t kSlots = 64, kLongest = 2400;
  // Delay of an overtaken datagram beyond the period of 1 ms.
  static constexpr std::chrono::nanoseconds kOvertaken{1'500'000};
  struct Slot {
    bool used = false;
    HostTime due;
    std::uint64_t number = 0;  // in the order of arrival
    std::size_t size = 0;
    std::array<std::byte, kLongest> bytes;
  };
  const Slot* earliest(HostTime now) const;
  void release(const Slot& slot);
  void keep(std::span<const std::byte> datagram, HostTime due);

  DatagramFaults faults_;
  std::mt19937_64 random_;
  std::array<Slot, kSlots> slots_;
  std::size_t waiting_ = 0;
  std::uint64_t number_ = 0;
};

}  // namespace multipanda::fci
