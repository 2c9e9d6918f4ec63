#pragma once

#include <cstdint>

// Counts what the loop must not do. Linked only into tests and benchmarks: it replaces malloc and its family
// and the locking functions of the C library for the whole program, and counts on a thread between arm() and
// disarm(). With a sanitizer (which replaces malloc itself) nothing is counted: see kLoopGuardWorks.
//
// Seen: heap calls of every library in the process (operator new included); mutexes, read-write locks,
// condition variables and semaphores, also tried ones, and with them std::mutex, std::shared_mutex,
// std::condition_variable; futex calls through syscall() (std::counting_semaphore, std::atomic::wait); page
// faults. Not seen: a futex entered by machine code that is not in these functions.
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
  // Begins counting on the calling thread, from zero.
  static void arm();
  // Ends it; what happened in between.
  static LoopGuardCounts disarm();
};

}  // namespace multipanda
