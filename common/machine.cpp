#include "common/machine.hpp"

#include <arpa/inet.h>
#include <cstdint>
#include <fstream>
#include <sys/utsname.h>
#include <thread>

#include <Eigen/Core>

namespace multipanda {
namespace {

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("model name")) continue;
    const std::size_t colon = line.find(": ");
    if (colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown";
}

}  // namespace

std::map<std::string, std::string> describe_machine() {
  utsname kernel{};
  (void)uname(&kernel);
  return {{"multipanda", MULTIPANDA_VERSION},
          {"mujoco", MULTIPANDA_MUJOCO},
          {"eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
                        std::to_string(EIGEN_MINOR_VERSION)},
          {"compiler",
#ifdef __clang__
           __VERSION__},  // starts with the compiler's name
#else
           "gcc " __VERSION__},
#endif
          {"processor", processor()},
          {"cores", std::to_string(std::thread::hardware_concurrency())},
          {"kernel", std::string(kernel.sysname) + " " + kernel.release},
          {"machine", kernel.machine}};
}

bool is_on_this_computer(const std::string& address) {
  in_addr parsed{};
  constexpr std::uint32_t kLoopbackNet = 127;
  return address == "localhost" ||
         (inet_pton(AF_INET, address.c_str(), &parsed) == 1 && ntohl(parsed.s_addr) >> 24 == kLoopbackNet);
}

}  // namespace multipanda
