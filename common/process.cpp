#include "common/process.hpp"

#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <optional>
#include <poll.h>
#include <pthread.h>
#include <spawn.h>
#include <sstream>
#include <stdexcept>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <system_error>
#include <thread>
#include <unistd.h>

namespace multipanda {

namespace {

constexpr std::size_t kKeptOutput = 8192;  // enough for the last lines of a traceback

// Starts a program whose standard output and error go to these descriptors, and whose descriptor 3 is
// `channel`
// (-1: none). Returns the error number or 0.
int spawn(const std::filesystem::path& program, std::vector<std::string> arguments, int output, int errors,
          int channel, pid_t& child) {
  arguments.insert(arguments.begin(), program.string());
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&files, errors, STDERR_FILENO);
  if (channel >= 0)
    posix_spawn_file_actions_adddup2(&files, channel, 3);  // also clears FD_CLOEXEC if it is 3
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none, standard;
  sigemptyset(&none);
  sigemptyset(&standard);
  for (const int signal : {SIGINT, SIGTERM, SIGPIPE}) sigaddset(&standard, signal);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &standard);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  const int error = posix_spawn(&child, argv[0], &files, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  return error;
}

int new_file(const std::filesystem::path& path, int otherwise) {
  if (path.empty()) return fcntl(otherwise, F_DUPFD_CLOEXEC, 0);
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) throw std::runtime_error(path.string() + " cannot be written: " + std::strerror(errno));
  return file;
}

std::string content_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string last_output(int file) {
  std::string text;
  char buffer[4096];
  while (true) {
    const ssize_t count = read(file, buffer, sizeof(buffer));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return text;
    text.append(buffer, static_cast<std::size_t>(count));
    if (text.size() > kKeptOutput) text.erase(0, text.size() - kKeptOutput);
  }
}

}  // namespace

ChildProcess::ChildProcess(const Options& options) : options_(options) {
  const int output = new_file(options.output, STDOUT_FILENO);
  const int errors = new_file(options.errors, STDERR_FILENO);
  const int error = spawn(options.program, options.arguments, output, errors, options.channel, process_);
  close(output);
  close(errors);
  if (error != 0) {
    throw std::runtime_error(options.program.string() + " does not start: " + std::strerror(error));
  }
}

ChildProcess::~ChildProcess() { stop(std::chrono::milliseconds(0)); }

bool ChildProcess::running() {
  while (!ended_) {
    const pid_t ended = waitpid(process_, &status_, WNOHANG);
    if (ended == 0) return true;
    ended_ = ended > 0 || errno != EINTR;
  }
  return false;
}

void ChildProcess::stop(std::chrono::milliseconds patience) {
  const auto until = std::chrono::steady_clock::now() + patience;
  if (running()) (void)kill(process_, patience.count() > 0 ? SIGTERM : SIGKILL);
  while (running()) {
    if (std::chrono::steady_clock::now() > until) (void)kill(process_, SIGKILL);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

int ChildProcess::exit_code() const { return ended_ && WIFEXITED(status_) ? WEXITSTATUS(status_) : -1; }
std::string ChildProcess::output() const { return content_of(options_.output); }
std::string ChildProcess::errors() const { return content_of(options_.errors); }

ProgramResult run_program(const std::filesystem::path& program, const std::vector<std::string>& arguments) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return {.reason = std::string("no pipe: ") + std::strerror(errno)};
  pid_t child = 0;
  const int error = spawn(program, arguments, ends[1], ends[1], -1, child);
  close(ends[1]);
  ProgramResult result;
  if (error == 0) {
    result.output = last_output(ends[0]);
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
    if (WIFSIGNALED(status)) result.reason = "ended by signal " + std::to_string(WTERMSIG(status));
  } else {
    result.reason = program.string() + " does not start: " + std::strerror(error);
  }
  close(ends[0]);
  return result;
}

SignalWatch::SignalWatch(std::function<void(int)> on_first) : on_first_(std::move(on_first)) {
  sigemptyset(&signals_);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals_, signal);
  if (const int error = pthread_sigmask(SIG_BLOCK, &signals_, &before_); error != 0) {
    throw std::system_error(error, std::generic_category(), "signals cannot be handled");
  }
  signal_file_ = signalfd(-1, &signals_, SFD_CLOEXEC);
  end_file_ = eventfd(0, EFD_CLOEXEC);
  if (signal_file_ < 0 || end_file_ < 0) {
    throw std::system_error(errno, std::generic_category(), "signals cannot be handled");
  }
  thread_ = std::thread([this] { watch(); });
}

SignalWatch::~SignalWatch() {
  const std::uint64_t one = 1;
  (void)!write(end_file_, &one, sizeof(one));
  thread_.join();
  close(signal_file_);
  close(end_file_);
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

void SignalWatch::watch() {
  using Clock = std::chrono::steady_clock;
  std::optional<Clock::time_point> first;
  for (;;) {
    pollfd files[2] = {{signal_file_, POLLIN, 0}, {end_file_, POLLIN, 0}};
    if (poll(files, 2, -1) < 0 && errno != EINTR) return;
    if ((files[1].revents & POLLIN) != 0) return;
    if ((files[0].revents & POLLIN) == 0) continue;
    signalfd_siginfo info{};
    if (read(signal_file_, &info, sizeof(info)) != static_cast<ssize_t>(sizeof(info))) continue;
    const int signal = static_cast<int>(info.ssi_signo);
    if (first && Clock::now() - *first >= kPatience) _exit(128 + signal);
    if (first) continue;
    first = Clock::now();
    on_first_(signal);
    // Pressed during that, perhaps later than kPatience.
    pollfd waiting{signal_file_, POLLIN, 0};
    while (poll(&waiting, 1, 0) > 0 && read(signal_file_, &info, sizeof(info)) > 0) {
    }
  }
}

}  // namespace multipanda
