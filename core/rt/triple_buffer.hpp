#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace multipanda {

// Passes the newest value from one writer to one reader; neither ever waits. The writer owns one of three
// slots and the reader another. The third is exchanged atomically.
template <typename T>
class TripleBuffer {
 public:
  TripleBuffer() = default;
  explicit TripleBuffer(const T& initial) { slots_.fill(initial); }

  // Writer thread.
  void write(const T& value) {
    slots_[write_] = value;
    write_ = static_cast<std::uint8_t>(
        middle_.exchange(static_cast<std::uint8_t>(write_ | kFresh), std::memory_order_acq_rel) & kIndex);
  }

  // Reader thread: true if `value()` changed to a newer value.
  bool take() {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    read_ = static_cast<std::uint8_t>(middle_.exchange(read_, std::memory_order_acq_rel) & kIndex);
    return true;
  }
  const T& value() const { return slots_[read_]; }

 private:
  static constexpr std::uint8_t kIndex = 3, kFresh = 4;
  std::array<T, 3> slots_{};
  alignas(64) std::uint8_t write_ = 0;
  alignas(64) std::atomic<std::uint8_t> middle_{1};
  alignas(64) std::uint8_t read_ = 2;
};

}  // namespace multipanda
