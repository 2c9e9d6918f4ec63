#include "core/rt/thread_setup.hpp"

#include <cerrno>
#include <cstring>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

namespace multipanda {
namespace {

std::string error_text(int error) { return std::strerror(error); }

SetupStep lock_memory() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return {"memory lock", true, {}};
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
  for (std::size_t i = 0; i < kBytes; i += 4096) stack[i] = 0;
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
