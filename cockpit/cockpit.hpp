#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cockpit/clients/clients.hpp"
#include "cockpit/server/hub.hpp"
#include "runtime/session.hpp"

namespace multipanda::cockpit {

// The cockpit of a program: its server and present contents.
class Cockpit {
 public:
  static constexpr std::uint16_t kUsualPort = 8765;  // as cli::kUsualCockpitPort

  // Listens on 127.0.0.1. No port: kUsualPort, or any free one if that is taken. Throws std::runtime_error.
  explicit Cockpit(std::optional<std::uint16_t> port);

  std::string address() const { return hub_->address(); }
  bool has_page() const { return hub_->has_page(); }
  Clients& clients() { return clients_; }
  // Shows one log, or two that are compared. Throws std::runtime_error.
  void show_logs(const std::vector<std::filesystem::path>& logs);

 private:
  Clients clients_;
  std::unique_ptr<Hub> hub_;  // uses the clients
};

// Shows a run during its lifetime.
class ShownRun {
 public:
  // `session` needs SessionOptions::share_records, and its on_loop must call objects->on_loop.
  ShownRun(Cockpit& cockpit, Session& session);
  ~ShownRun();
  ShownRun(const ShownRun&) = delete;

 private:
  Cockpit& cockpit_;
};

}  // namespace multipanda::cockpit
