#pragma once

#include <memory>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include "cli/console.hpp"
#include "cockpit/cockpit.hpp"
#include "runtime/session.hpp"

namespace multipanda::cli {

struct CockpitArguments {
  bool asked = false;
  std::optional<std::uint16_t> port;
};

// --cockpit [PORT]
void add_cockpit_arguments(CLI::App* command, CockpitArguments& arguments);

// The cockpit of a command, if one was asked for: listens, and shows a run.
class OpenedCockpit {
 public:
  // Listens, and sets what the run needs for it. Signals must be set up before: this starts a thread. Throws
  // std::runtime_error.
  OpenedCockpit(const CockpitArguments& arguments, const Console& console, const Scene& scene,
                SessionOptions& session);

  void show(Session& session);  // before its start; prints the address
  void end();                   // before the session is destroyed; idempotent

 private:
  const Console& console_;
  std::shared_ptr<cockpit::ObjectPoses> objects_;  // the loop of the session writes them
  std::unique_ptr<cockpit::Cockpit> cockpit_;
  std::unique_ptr<cockpit::ShownRun> shown_;
};

// Prints the address on a line of its own, and says so if there is no page.
void print_address(const cockpit::Cockpit& cockpit, const Console& console);

}  // namespace multipanda::cli
