#include "logs/machine.hpp"

#include <ctime>
#include <fstream>
#include <sys/utsname.h>
#include <thread>

namespace multipanda {

std::map<std::string, std::string> machine_info() {
  std::map<std::string, std::string> info;
  info["version"] = MULTIPANDA_VERSION;
  info["compiler"] = std::string(
#ifdef __clang__
      "clang "
#else
      "gcc "
#endif
      __VERSION__);
  info["cores"] = std::to_string(std::thread::hardware_concurrency());
  utsname system{};
  if (uname(&system) == 0)
    info["kernel"] = std::string(system.sysname) + " " + system.release + " " + system.machine;
  std::ifstream cpus("/proc/cpuinfo");
  for (std::string line; std::getline(cpus, line);) {
    if (!line.starts_with("model name")) continue;
    const std::size_t colon = line.find(": ");
    if (colon != std::string::npos) info["cpu"] = line.substr(colon + 2);
    break;
  }
  return info;
}

std::string wall_time_now() {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char text[64];
  const std::size_t length = std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%S%z", &local);
  return {text, length};
}

}  // namespace multipanda
