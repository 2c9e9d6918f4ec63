#include "experiments/refine/arm_process.hpp"

#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <spawn.h>
#include <sstream>
#include <stdexcept>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;

constexpr std::chrono::seconds kPatience{20};  // until it listens: it reads a scene and builds a world

std::string content_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

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

ArmProcess::ArmProcess(const Options& options) {
  std::vector<std::string> words{options.program.string(),
                                 "virtual-arm",
                                 options.scene.string(),
                                 "--hidden",
                                 std::to_string(options.hidden),
                                 "--pace",
                                 "lockstep",
                                 "--idle-stands-still",
                                 "--no-gripper",
                                 "--json"};
  for (const auto& [arm, address] : options.addresses) {
    words.insert(words.end(), {"--bind", arm + "=" + address});
  }
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  const fs::path said = fs::path(options.messages).concat(".json");
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  constexpr int kNew = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, said.c_str(), kNew, 0644);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, options.messages.c_str(), kNew, 0644);
  posix_spawnattr_t attributes;  // its own signals: this program may have blocked its
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
  const int error = posix_spawn(&process_, argv[0], &files, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) {
    process_ = -1;
    throw std::runtime_error("the virtual arms' process " + words[0] +
                             " does not start: " + std::strerror(error));
  }
  const auto until = steady_clock::now() + kPatience;
  while (content_of(said).find("\"listening\"") == std::string::npos) {
    int status = 0;
    const bool ended = waitpid(process_, &status, WNOHANG) == process_;
    if (ended) process_ = -1;
    if (ended || steady_clock::now() > until) {
      end();
      throw std::runtime_error("the virtual arms of " + options.scene.string() +
                               (ended ? " ended before they listened: " : " do not listen: ") +
                               content_of(options.messages));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

ArmProcess::~ArmProcess() { end(); }

void ArmProcess::end() {
  if (process_ < 0) return;
  (void)kill(process_, SIGTERM);
  const auto until = steady_clock::now() + std::chrono::seconds(3);
  int status = 0;
  while (waitpid(process_, &status, WNOHANG) == 0) {
    if (steady_clock::now() > until) {
      (void)kill(process_, SIGKILL);
      (void)waitpid(process_, &status, 0);
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  process_ = -1;
}

}  // namespace multipanda
