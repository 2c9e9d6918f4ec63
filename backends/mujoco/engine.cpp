
#include "backends/mujoco/engine.hpp"

#include <array>
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

// MuJoCo is C: longjmp skips no destructors here; an exception would pass through frames that cannot unwind.
void on_error(const char* message) {
  std::strncpy(error_text.data(), message, kText - 1);
  error_text[kText - 1] = '\0';
  if (return_point != nullptr) std::longjmp(*return_point, 1);
  std::fprintf(stderr, "MuJoCo error outside a guarded call: %s\n", message);
  std::abort();
}

// MuJoCo's own handler writes a file.
void on_warning(const char*) {}

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
