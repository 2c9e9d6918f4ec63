#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include "cli/console.hpp"
#include "cockpit/cockpit.hpp"
#include "runtime/session_viewer.hpp"

namespace multipanda::cli {

struct CockpitArguments {
  bool asked = false;
  std::optional<std::uint16_t> port;
};

// --cockpit [PORT]
void add_cockpit_arguments(
    CLI::App* command, CockpitArguments& arguments,
    const std::string& help =
        "Show and command the run in a browser on this computer, at a port of 127.0.0.1");

// The cockpit of a command, if one was asked for: listens, and shows its runs, one after the other.
class OpenedCockpit final : public SessionViewer {
 public:
  // Listens. Signals must be set up before: this starts a thread. Throws std::runtime_error.
  OpenedCockpit(const CockpitArguments& arguments, const Console& console);

  explicit operator bool() const { return cockpit_ != nullptr; }
  void on_owed_stop(std::function<void()> call);  // Desk::on_owed_stop
  void prepare(const Scene& scene, SessionOptions& session) override;
  void show(Session& session) override;  // the first time it prints the address
  void end() override;

 private:
  const Console& console_;
  bool printed_ = false;
  std::shared_ptr<cockpit::ObjectPoses> objects_;  // the loop of the session writes them
  std::unique_ptr<cockpit::Cockpit> cockpit_;
  std::unique_ptr<cockpit::ShownRun> shown_;
};

// Shows one log, or two that are compared, until Ctrl-C, or until standard input ends. Returns the exit code.
int show_logs(const std::vector<std::filesystem::path>& logs, std::optional<std::uint16_t> port,
              bool until_input_ends);

// Prints the address on a line of its own, and says so if there is no page.
void print_address(const cockpit::Cockpit& cockpit, const Console& console);

}  // namespace multipanda::cli
