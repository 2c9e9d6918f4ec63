#include "core/rt/thread_setup.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

namespace multipanda {
namespace {

std::string error_text(int error) { return std::strerror(error); }

constexpr std::size_t kPage = 4096;

// Libraries that only read and write files, which the loop never does.
bool reads_files(const char* mapping) {
  constexpr std::array kNames{"/libzstd.", "/libyaml-cpp.", "/liburdfdom", "/libtinyxml2."};
  return std::any_of(kNames.begin(), kNames.end(),
                     [&](const char* name) { return std::strstr(mapping, name) != nullptr; });
}

// Brings code, data and heap into memory, and keeps them there. The stacks of other threads stay as they are,
// since most of their 8 MB each will never be used; glibc puts a page without access below each. What cannot
// be locked are pages of the kernel. Returns false if the mappings are not readable.
bool lock_mappings(std::size_t stack) {
  std::FILE* const maps = std::fopen("/proc/self/maps", "r");
  if (maps == nullptr) return false;
  std::uintptr_t guard_end = 0;
  std::array<char, 512> line{};
  while (std::fgets(line.data(), line.size(), maps) != nullptr) {
    std::uintptr_t begin = 0, end = 0;
    std::array<char, 5> access{};
    if (std::sscanf(line.data(), "%zx-%zx %4s", &begin, &end, access.data()) != 3) continue;
    if (access[0] == '-' && end - begin == kPage) guard_end = end;
    if (access[0] != 'r' || access[3] != 'p' || reads_files(line.data())) continue;
    const bool is_file = std::strchr(line.data(), '/') != nullptr;
    if (begin == guard_end && !is_file) begin += stack;  // behind it may be other memory
    // The kernel gives addresses as text.
    // NOLINTNEXTLINE(performance-no-int-to-ptr)
    if (begin < end) (void)mlock(reinterpret_cast<void*>(begin), end - begin);
  }
  return std::fclose(maps) == 0;
}

// Of threads that are started without a size of their own [bytes]; 0: unknown, then stacks are locked, too.
std::size_t usual_stack() {
  pthread_attr_t attributes;
  std::size_t size = 0;
  if (pthread_getattr_default_np(&attributes) != 0) return size;
  (void)pthread_attr_getstacksize(&attributes, &size);
  (void)pthread_attr_destroy(&attributes);
  return size;
}

// Locks present and later memory, which includes the stacks of later threads.
SetupStep lock_memory() {
  if (mlockall(MCL_CURRENT | MCL_ONFAULT) == 0 && mlockall(MCL_FUTURE) == 0 &&
      (lock_mappings(usual_stack()) || mlockall(MCL_CURRENT | MCL_FUTURE) == 0)) {
    return {"memory lock", true, {}};
  }
  return {"memory lock", false,
          error_text(errno) +
              ": raise the limit with 'ulimit -l unlimited' (memlock in /etc/security/limits.conf)"};
}

SetupStep set_fifo(int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  // Threads started by this one are ordinary: they would compete with it.
  const int error = sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0 ? 0 : errno;
  const std::string what = "SCHED_FIFO " + std::to_string(priority);
  if (error == 0) return {what, true, {}};
  return {what, false,
          error_text(error) +
              ": allow it with 'ulimit -r 99' (rtprio in /etc/security/limits.conf), or run as root"};
}

SetupStep pin_to(int cpu) {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  const std::string what = "affinity to core " + std::to_string(cpu);
  if (cpu < 0 || cpu >= CPU_SETSIZE) return {what, false, "this core does not exist"};
  CPU_SET(static_cast<std::size_t>(cpu), &cpus);
  const int error = pthread_setaffinity_np(pthread_self(), sizeof(cpus), &cpus);
  if (error == 0) return {what, true, {}};
  return {what, false,
          error_text(error) + ": this machine or container does not offer core " + std::to_string(cpu)};
}

// Touches the stack once, so that the first deep call of the loop causes no page fault.
void prefault_stack() {
  constexpr std::size_t kBytes = std::size_t{256} * 1024;
  volatile unsigned char stack[kBytes];
  for (std::size_t i = 0; i < kBytes; i += kPage) stack[i] = 0;
  (void)stack[0];
}

}  // namespace

std::vector<SetupStep> set_up_thread(const ThreadSetup& setup) {
  std::vector<SetupStep> steps;
  if (setup.lock_memory) steps.push_back(lock_memory());
  if (setup.cpu) steps.push_back(pin_to(*setup.cpu));
  if (setup.fifo_priority) steps.push_back(set_fifo(*setup.fifo_priority));
  prefault_stack();
  return steps;
}

}  // namespace multipanda
