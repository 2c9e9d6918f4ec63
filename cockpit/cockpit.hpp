#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cockpit/desk/desk.hpp"
#include "cockpit/run/object_poses.hpp"
#include "cockpit/server/hub.hpp"
#include "runtime/session.hpp"

namespace multipanda::cockpit {

// The cockpit of a program: its server, and what it shows at the moment.
class Cockpit {
 public:
  static constexpr std::uint16_t kUsualPort = 8765;

  // Listens on 127.0.0.1. No port: kUsualPort, or any free one if that is taken. Throws std::runtime_error.
  explicit Cockpit(std::optional<std::uint16_t> port);

  std::string address() const { return hub_->address(); }
  bool has_page() const { return has_page_; }
  Desk& desk() { return desk_; }
  // Shows one log, or two that are compared. Throws std::runtime_error.
  void show_logs(const std::vector<std::filesystem::path>& logs);

 private:
  Desk desk_;
  bool has_page_ = false;
  std::unique_ptr<Hub> hub_;  // uses the desk
};

// Shows a run for as long as this exists.
class ShownRun {
 public:
  // `session` has SessionOptions::share_records, and its on_loop calls objects->on_loop.
  ShownRun(Cockpit& cockpit, Session& session, ObjectPoses* objects);
  ~ShownRun();
  ShownRun(const ShownRun&) = delete;

 private:
  Cockpit& cockpit_;
};

}  // namespace multipanda::cockpit
