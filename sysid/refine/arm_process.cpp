#include "sysid/refine/arm_process.hpp"

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <unistd.h>

namespace multipanda {
namespace {

using std::chrono::steady_clock;

constexpr std::chrono::seconds kPatience{20};  // to read the scene, build the world and listen

}  // namespace

std::vector<std::string> free_addresses(std::size_t count) {
  static std::atomic<unsigned> next{0};
  const auto process = static_cast<unsigned>(getpid());
  std::vector<std::string> addresses;
  for (std::size_t i = 0; i < count; ++i) {
    const unsigned number = next.fetch_add(1);
    addresses.push_back("127." + std::to_string(1 + (process + number / 250) % 250) + "." +
                        std::to_string((process / 250) % 250) + "." + std::to_string(1 + number % 250));
  }
  return addresses;
}

ArmProcess::ArmProcess(const Options& options)
    : process_({.program = options.program,
                .arguments = arguments(options),
                .output = std::filesystem::path(options.messages).concat(".json"),
                .errors = options.messages}) {
  const auto until = steady_clock::now() + kPatience;
  while (process_.output().find("\"listening\"") == std::string::npos) {
    const bool ended = !process_.running();
    if (ended || steady_clock::now() > until) {
      throw std::runtime_error("the virtual arms of " + options.scene.string() +
                               (ended ? " ended before they were ready: " : " do not listen: ") +
                               process_.errors());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

ArmProcess::~ArmProcess() { process_.stop(std::chrono::seconds(3)); }

std::vector<std::string> ArmProcess::arguments(const Options& options) {
  std::vector<std::string> all{"virtual-arm",
                               options.scene.string(),
                               "--hidden",
                               std::to_string(options.hidden),
                               "--pace",
                               "lockstep",
                               "--idle-stands-still",
                               "--no-gripper",
                               "--json"};
  if (options.motors) {
    all.insert(all.end(),
               {"--rotor-hidden", "0.5", "--transmission-stiffness", "10000", "--gear-ripple", "0.2"});
  }
  for (const auto& [arm, address] : options.addresses) all.insert(all.end(), {"--bind", arm + "=" + address});
  return all;
}

}  // namespace multipanda
