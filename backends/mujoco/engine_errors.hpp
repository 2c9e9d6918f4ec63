#pragma once

#include <cstdint>
#include <functional>
#include <string>

// MuJoCo reports errors through a handler of the whole process that must not return, and warnings through
// one that by default writes a file. Here neither ends the process nor writes anything.
namespace multipanda {

// Calls `work`; true if MuJoCo reported no error. After an error the text is in last_engine_error() of this
// thread and the call was left where the error occurred: what it worked on is not to be used any more.
// `work` must not own anything with a destructor on its stack.
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

// Called by everything here that uses MuJoCo, before it does.
void install_engine_handlers();

}  // namespace multipanda
