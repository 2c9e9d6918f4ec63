#include "experiments/generator_process.hpp"

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
#include <vector>

#include "core/types/time.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

std::string content_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

}  // namespace

GeneratorProcess::GeneratorProcess(const Options& options)
    : report_(fs::path(options.messages).concat(".json")), messages_(options.messages) {
  std::vector<std::string> words{
      options.program.string(),        "generate", "circular-field", options.course.string(), "--seconds",
      std::to_string(options.seconds), "--json"};
  if (options.ros_node.empty()) {
    words.insert(words.end(), {"--socket", options.socket.string()});
  } else {
    words.insert(words.end(), {"--ros", "--node", options.ros_node});
  }
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  constexpr int kNew = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, report_.c_str(), kNew, 0644);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, messages_.c_str(), kNew, 0644);
  // This program watches its signals on a thread of its own and blocks them elsewhere; the child has its own
  // watch. Ctrl-C reaches both.
  posix_spawnattr_t attributes;
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
    throw std::runtime_error("the motion generator " + words[0] + " does not start: " + std::strerror(error));
  }
}

GeneratorProcess::~GeneratorProcess() {
  if (process_ < 0 || ended_) return;
  signal(SIGKILL);
  reap(true);
}

void GeneratorProcess::signal(int number) const { (void)kill(process_, number); }

bool GeneratorProcess::reap(bool block) {
  while (!ended_) {
    const pid_t got = waitpid(process_, &status_, block ? 0 : WNOHANG);
    if (got == 0) return false;
    if (got < 0 && errno == EINTR) continue;
    ended_ = true;
  }
  return true;
}

bool GeneratorProcess::running() { return !reap(false); }

nlohmann::ordered_json GeneratorProcess::finish(double timeout_s) {
  if (running()) signal(SIGTERM);
  const HostTime begin = host_now();
  while (running() && seconds(host_now() - begin) < timeout_s)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  if (!ended_) {
    signal(SIGKILL);
    reap(true);
  }
  auto report = nlohmann::ordered_json::parse(content_of(report_), nullptr, false);
  if (report.is_discarded()) {
    throw std::runtime_error("the motion generator left no report (exit status " +
                             std::to_string(WIFEXITED(status_) ? WEXITSTATUS(status_) : -1) +
                             "); it said:\n" + content_of(messages_));
  }
  return report;
}

std::filesystem::path own_program() { return fs::read_symlink("/proc/self/exe"); }

}  // namespace multipanda
