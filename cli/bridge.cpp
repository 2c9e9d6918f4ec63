#include <array>
#include <filesystem>
#include <memory>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "common/own_files.hpp"
#include "runtime/live_input/client.hpp"
#include "runtime/live_input/socket_path.hpp"

// `multipanda bridge`: the far end of a client on another computer, started there by ssh; it is
// python/multipanda/bridge.py.
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

int bridge(const std::string& run) {
  std::string python = page_python().string(), socket = socket_of(run).string();
  const fs::path share = share_folder();
  std::string script =
      (share / "python/multipanda/bridge.py").string();  // the source tree, or a package's folder
  if (!fs::exists(script)) script = (share.parent_path().parent_path() / "bridge.py").string();
  std::string isolated = "-I", no_cache = "-B";
  std::array<char*, 6> words{python.data(), isolated.data(), no_cache.data(),
                             script.data(), socket.data(),   nullptr};
  execv(python.c_str(), words.data());
  throw std::runtime_error("cannot start " + python);
}

}  // namespace

void add_bridge(Program& program) {
  auto run = std::make_shared<std::string>();
  CLI::App* command = program.add(
      "bridge", "Connect a client on another computer to a run; ssh starts it there",
      "  multipanda bridge two_arms      as mp.connect(\"ssh://user@control/two_arms\") starts it there");
  command->add_option("run", *run, "Name or socket of the run (default: the only running scene)");
  program.on(command, [run] { return bridge(*run); });
}

}  // namespace multipanda::cli
