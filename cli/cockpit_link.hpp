#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "backends/mujoco/plant.hpp"
#include "fci/server/virtual_arms.hpp"
#include "runtime/session.hpp"

namespace multipanda::cli {

// Interface of the library libmultipanda_cockpit.so: a page server and its contents. Programs load it only
// for a page, so that other runs have no server in their process and need not build one. It exports
//   unsigned multipanda_cockpit_version()
//   CockpitLink* multipanda_open_cockpit(const std::optional<std::uint16_t>* port)   listens; throws
//   std::runtime_error
class CockpitLink : public SessionViewer {
 public:
  virtual std::string address() const = 0;
  virtual bool has_page() const = 0;
  virtual void on_stop_between_runs(std::function<void()> call) = 0;  // Clients::on_stop_between_runs
  virtual void show_logs(const std::vector<std::filesystem::path>& logs) = 0;
  // The world of virtual arms, built from this scene: its thread calls the function after each period.
  virtual std::function<void(const MujocoPlant&)> watch_world(const Scene& scene) = 0;
  virtual void show_world(
      fci::VirtualArms& arms) = 0;  // after watch_world; `arms` outlive it or close() is called
  virtual void close(const std::string& why) = 0;  // clears the display
};

// Contains the sizes of shared types, to detect a library of another build.
inline constexpr unsigned kCockpitVersion =
    1'000'000u + static_cast<unsigned>(sizeof(Scene) + 3 * sizeof(Session) + 5 * sizeof(SessionOptions) +
                                       7 * sizeof(fci::VirtualArms)) %
                     1'000'000u;

}  // namespace multipanda::cli
