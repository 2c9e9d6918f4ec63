#include <cstdlib>
#include <filesystem>
#include <memory>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "common/own_files.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/live_input/socket_path.hpp"

// Commands that are programs of python/multipanda: `bridge`, the far end of a client on another computer,
// started there by ssh, `new` and `arm`.
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

fs::path socket_of(const std::string& run) {
  if (run.empty()) return only_running_socket();
  if (run.find('/') != std::string::npos) return run;
  std::vector<std::string> names;
  for (const fs::path& socket :
       all_running_sockets()) {  // ssh's environment may have another folder for them
    if (socket.stem() == run) return socket;
    names.push_back(socket.stem());
  }
  throw std::runtime_error(fmt::format("no run '{}' on this computer; running: {}", run,
                                       names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

int run_python(const char* name, std::vector<std::string> words) {
  const fs::path share = share_folder();
  fs::path script = share / "python/multipanda" / name;  // the source tree, or a package's folder
  if (!fs::exists(script)) script = share.parent_path().parent_path() / name;
  words.insert(words.begin(), {page_python().string(), "-I", "-B", script.string()});
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  execv(argv[0], argv.data());
  throw std::runtime_error("cannot start " + words[0]);
}

}  // namespace

void add_bridge(Program& program) {
  auto run = std::make_shared<std::string>();
  CLI::App* command = program.add(
      "bridge", "Connect a client on another computer to a run; ssh starts it there",
      "  multipanda bridge two_arms      as mp.connect(\"ssh://user@control/two_arms\") starts it there");
  option(command, "run", *run, "Name or socket of the run (default: the only running scene)");
  program.on(command, [run] { return run_python("bridge.py", {socket_of(*run).string()}); });
}

void add_new(Program& program) {
  CLI::App* command =
      program.add("new", "Write a scene of your own, by six questions", "  multipanda new scene");
  command->set_help_flag();  // the program has its own options and help
  command->prefix_command();
  program.on(command, [command] {
    setenv("MULTIPANDA_PROGRAM", fs::read_symlink("/proc/self/exe").c_str(), 1);
    return run_python("new_scene.py", command->remaining());
  });
}

void add_arm(Program& program) {
  CLI::App* command =
      program.add("arm", "Unlock and lock a real arm's joints, activate its FCI (untried on a real arm)",
                  "  multipanda arm ready 172.16.0.2");
  command->set_help_flag();
  command->prefix_command();
  program.on(command, [command] { return run_python("desk.py", command->remaining()); });
}

}  // namespace multipanda::cli
