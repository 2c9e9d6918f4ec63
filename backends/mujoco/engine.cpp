
#include "backends/mujoco/engine.hpp"

#include <array>
#include <atomic>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include "common/own_files.hpp"

namespace multipanda {

#define MULTIPANDA_DEFINE(name) decltype(&::name) name = nullptr;
MULTIPANDA_ENGINE(MULTIPANDA_DEFINE)
#undef MULTIPANDA_DEFINE

namespace {

constexpr std::size_t kText = 512;
thread_local std::jmp_buf* return_point = nullptr;
thread_local std::array<char, kText> error_text{};
std::atomic<std::uint64_t> warning_count{0};
// Written by the thread that acquires the flag, so that a warning in the loop never waits.
std::atomic_flag warning_text_busy = ATOMIC_FLAG_INIT;
std::array<char, kText> warning_text{};

void copy_text(const char* from, std::array<char, kText>& to) {
  std::strncpy(to.data(), from, kText - 1);
  to[kText - 1] = '\0';
}

// MuJoCo is C: longjmp skips no destructors here; an exception would pass through frames that cannot unwind.
void on_error(const char* message) {
  copy_text(message, error_text);
  if (return_point != nullptr) std::longjmp(*return_point, 1);
  std::fprintf(stderr, "MuJoCo error outside a guarded call: %s\n", message);
  std::abort();
}

void on_warning(const char* message) {
  warning_count.fetch_add(1, std::memory_order_relaxed);
  if (warning_text_busy.test_and_set(std::memory_order_acquire)) return;
  copy_text(message, warning_text);
  warning_text_busy.clear(std::memory_order_release);
}

}  // namespace

bool without_engine_error(void (*work)(void*), void* argument) {
  std::jmp_buf here;
  std::jmp_buf* const before = return_point;
  return_point = &here;
  const bool reached_end = setjmp(here) == 0;
  if (reached_end) work(argument);
  return_point = before;
  return reached_end;
}

const char* last_engine_error() { return error_text.data(); }

std::uint64_t engine_warnings() { return warning_count.load(std::memory_order_relaxed); }

std::string last_engine_warning() {
  while (warning_text_busy.test_and_set(std::memory_order_acquire)) {
  }
  std::string text = warning_text.data();
  warning_text_busy.clear(std::memory_order_release);
  return text;
}

void load_engine() {
  static std::once_flag once;
  std::call_once(once, [] {
    const auto& engine =
        *static_cast<const Engine*>(from_own_library("libmultipanda_mujoco.so", "multipanda_engine"));
#define MULTIPANDA_TAKE(name) name = engine.name;
    MULTIPANDA_ENGINE(MULTIPANDA_TAKE)
#undef MULTIPANDA_TAKE
    *mju_user_error = on_error;
    *mju_user_warning = on_warning;
  });
}

}  // namespace multipanda
