#pragma once

#include <cstdint>
#include <functional>
#include <string>

// MuJoCo reports errors through a process-wide handler that must not return, and warnings through one that by
// default writes a file. These handlers neither end the process nor write a file.
namespace multipanda {

// Calls `work`; true if MuJoCo reported no error. After an error, last_engine_error() of this thread has the
// text. The call was aborted at the error: do not use its data any more. `work` must not own
// anything with a destructor on its stack.
bool without_engine_error(void (*work)(void*), void* argument);

// The same for any callable, without allocating.
template <typename Work>
bool without_engine_error(Work&& work) {
  return without_engine_error(
      [](void* argument) { (*static_cast<std::remove_reference_t<Work>*>(argument))(); }, &work);
}

const char* last_engine_error();

// Warnings of MuJoCo in this process since its start.
std::uint64_t engine_warnings();
// Text of the last one, empty if none. Off the loop.
std::string last_engine_warning();

// Must be called before any use of MuJoCo, off the loop: loads it (engine.hpp) and sets these handlers.
// Throws std::runtime_error if there is no library.
void load_engine();

}  // namespace multipanda
