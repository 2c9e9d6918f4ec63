#pragma once

#include <cstdint>

// Counts operations that the loop must not perform. It is linked only into tests and benchmarks. It replaces
// malloc and its family and the locking functions of the C library in the whole program, and counts on a
// thread between arm() and disarm(). With a sanitizer, which replaces malloc itself, nothing is counted: see
// kLoopGuardWorks. It counts heap calls of every library in the process (operator new included); mutexes,
// read-write locks, condition variables and semaphores (including try calls), and with them std::mutex,
// std::shared_mutex and std::condition_variable; futex calls through syscall() (std::counting_semaphore,
// std::atomic::wait); and page faults. It cannot detect a futex call by machine code outside these functions.
namespace multipanda {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || defined(MULTIPANDA_NO_LOOP_GUARD)
inline constexpr bool kLoopGuardWorks = false;
#else
inline constexpr bool kLoopGuardWorks = true;
#endif

struct LoopGuardCounts {
  std::uint64_t heap_calls = 0;
  std::uint64_t lock_calls = 0;
  std::uint64_t page_faults = 0;  // minor and major
};

class LoopGuard {
 public:
  // Starts counting on the calling thread, from zero.
  static void arm();
  // Stops counting and returns the counts since arm().
  static LoopGuardCounts disarm();
};

}  // namespace multipanda
