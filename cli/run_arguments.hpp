#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "cli/program.hpp"
#include "runtime/backends.hpp"
#include "runtime/session.hpp"

namespace multipanda::cli {

class CockpitLink;

inline constexpr std::uint16_t kUsualCockpitPort = 8765;

struct CockpitArguments {
  bool asked = false;
  std::optional<std::uint16_t> port;
};

// --cockpit [PORT]
void add_cockpit_arguments(
    CLI::App* command, CockpitArguments& arguments,
    const std::string& help =
        "Show and command the run in a browser on this computer, at a port of 127.0.0.1");

// Loads the library with the page server, which is never unloaded, and listens. Signals must be set up
// before: this starts a thread. Throws std::runtime_error.
std::unique_ptr<CockpitLink> open_cockpit(std::optional<std::uint16_t> port);

// Prints the address on a separate line, and whether there is a page.
void print_address(const CockpitLink& cockpit, const Console& console);

// The cockpit of a command, if requested: listens, and shows its runs in sequence.
class OpenedCockpit final : public SessionViewer {
 public:
  OpenedCockpit(const CockpitArguments& arguments, const Console& console);  // as open_cockpit()
  ~OpenedCockpit();

  explicit operator bool() const { return cockpit_ != nullptr; }
  void on_stop_between_runs(std::function<void()> call);  // Clients::on_stop_between_runs
  void prepare(SessionOptions& session) override;
  void show(Session& session) override;  // prints the address on the first call
  void end() override;

 private:
  const Console& console_;
  bool printed_ = false;
  std::unique_ptr<CockpitLink> cockpit_;
};

// Shows one log, or compares two, until Ctrl-C or the end of standard input. Returns the exit code.
int show_logs(const std::vector<std::filesystem::path>& logs, std::optional<std::uint16_t> port,
              bool until_input_ends);

// --backend, --log and --address of the commands that run arms.
struct BackendArguments {
  std::string backend;                 // empty: as in the scene
  std::vector<std::string> addresses;  // "left=127.0.0.1"
  std::string log;                     // of the backend replay
};

void add_backend_arguments(CLI::App* command, BackendArguments& arguments);
// --backend and --address of experiments: simulated arms, virtual ones, or all of another process.
void add_experiment_arguments(CLI::App* command, BackendArguments& arguments);

// Throws UsageError for invalid arguments or a combination that is not allowed.
BackendOptions backend_options(const BackendArguments& arguments);

}  // namespace multipanda::cli
