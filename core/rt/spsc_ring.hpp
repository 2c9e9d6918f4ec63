#pragma once

#include <atomic>
#include <cstddef>
#include <vector>

namespace multipanda {

// Bounded queue from one thread to another. Slots are built once and reused in place, so that large records
// are filled without a copy. It never waits: push fails on a full ring, and an empty ring returns nothing.
template <typename T>
class SpscRing {
 public:
  SpscRing(std::size_t capacity, const T& prototype) : slots_(capacity + 1, prototype) {}
  explicit SpscRing(std::size_t capacity) : SpscRing(capacity, T{}) {}

  // Producer: a slot to fill, or nullptr if the ring is full. push() makes it visible.
  T* back() {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    return next(head) == tail_.load(std::memory_order_acquire) ? nullptr : &slots_[head];
  }
  void push() { head_.store(next(head_.load(std::memory_order_relaxed)), std::memory_order_release); }
  bool push(const T& value) {
    T* slot = back();
    if (slot == nullptr) return false;
    *slot = value;
    push();
    return true;
  }

  // Consumer: the oldest element, or nullptr if the ring is empty. pop() releases it.
  T* front() {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    return tail == head_.load(std::memory_order_acquire) ? nullptr : &slots_[tail];
  }
  // The i-th oldest; i < size().
  const T& peek(std::size_t i) const {
    const std::size_t at = tail_.load(std::memory_order_relaxed) + i;
    return slots_[at < slots_.size() ? at : at - slots_.size()];
  }
  void pop() { tail_.store(next(tail_.load(std::memory_order_relaxed)), std::memory_order_release); }

  // Either side; a snapshot.
  std::size_t size() const {
    const std::size_t head = head_.load(std::memory_order_acquire),
                      tail = tail_.load(std::memory_order_acquire);
    return head >= tail ? head - tail : head + slots_.size() - tail;
  }
  std::size_t capacity() const { return slots_.size() - 1; }

 private:
  std::size_t next(std::size_t i) const { return i + 1 == slots_.size() ? 0 : i + 1; }
  std::vector<T> slots_;
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
};

}  // namespace multipanda
