#include "virtual_arms.hpp"

#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <signal.h>
#include <stdexcept>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

namespace multipanda::ros2_control_tests {
namespace {

// Loopback addresses of this process alone, since the arms' ports are fixed.
std::string free_address(std::size_t number) {
  static std::size_t used = 0;
  const auto pid = static_cast<std::size_t>(getpid());
  return "127." + std::to_string(120 + pid / 65536 % 100) + "." + std::to_string(pid / 256 % 256) + "." +
         std::to_string((pid + 61 * (number + 7 * used++)) % 254 + 1);
}

void set_close_on_exec(const int (&ends)[2]) {
  for (const int end : ends) fcntl(end, F_SETFD, FD_CLOEXEC);
}

}  // namespace

std::string program() {
  const char* path = std::getenv("MULTIPANDA_PROGRAM");
  return path != nullptr && std::filesystem::exists(path) ? path : "";
}

VirtualArms::VirtualArms(const std::vector<std::string>& names, std::vector<std::string> addresses)
    : addresses_(std::move(addresses)) {
  std::string pattern = (std::filesystem::temp_directory_path() / "virtual_arms_XXXXXX.yaml").string();
  const int file = mkstemps(pattern.data(), 5);
  if (file < 0) throw std::runtime_error("cannot make a temporary file in " + pattern);
  close(file);
  scene_file_ = pattern;
  std::ofstream scene(scene_file_);
  scene << "name: tested\narms:\n";
  std::vector<std::string> command = {program(), "virtual-arm", scene_file_, "--pace", "lockstep", "--json"};
  for (std::size_t i = 0; i < names.size(); ++i) {
    scene << "  - {name: " << names[i] << ", model: fer, base: {position_m: [0, "
          << 0.6 * static_cast<double>(i) << ", 0]}}\n";
    if (addresses_.size() <= i) addresses_.push_back(free_address(i));
    command.insert(command.end(), {"--bind", names[i] + "=" + addresses_[i]});
  }
  scene.close();

  int in[2], out[2], errors[2];
  if (pipe(in) != 0 || pipe(out) != 0 || pipe(errors) != 0) throw std::runtime_error("cannot make a pipe");
  set_close_on_exec(in);
  set_close_on_exec(out);
  set_close_on_exec(errors);
  std::vector<char*> arguments;
  for (auto& argument : command) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  process_ = fork();
  if (process_ == 0) {
    dup2(in[0], 0);
    dup2(out[1], 1);
    dup2(errors[1], 2);
    execv(arguments[0], arguments.data());
    _exit(127);
  }
  close(in[0]);
  close(out[1]);
  close(errors[1]);
  in_ = in[1];
  out_ = out[0];
  errors_ = errors[0];
  const std::string first = line(out_);
  if (first.find("listening") == std::string::npos)
    throw std::runtime_error("virtual-arm: " + first + line(errors_));
}

VirtualArms::~VirtualArms() {
  if (process_ > 0) {
    kill(process_, SIGTERM);
    waitpid(process_, nullptr, 0);
  }
  for (const int end : {in_, out_, errors_}) close(end);
  std::filesystem::remove(scene_file_);
}

std::string VirtualArms::line(int descriptor) {
  std::string text;
  char c = 0;
  while (read(descriptor, &c, 1) == 1 && c != '\n') text += c;
  return text;
}

std::string VirtualArms::control(const std::string& command) {
  const std::string text = command + "\n";
  if (write(in_, text.data(), text.size()) != static_cast<ssize_t>(text.size())) return "cannot write";
  // Skips earlier output about connections.
  for (int i = 0; i < 100; ++i) {
    const std::string answer = line(errors_);
    if (answer.find("ok") != std::string::npos || answer.find("expected") != std::string::npos ||
        answer.empty()) {
      return answer;
    }
  }
  return "no answer";
}

}  // namespace multipanda::ros2_control_tests
