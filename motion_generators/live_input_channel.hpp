#pragma once

#include <optional>

#include "motion_generators/set_point_channel.hpp"
#include "runtime/live_input/client.hpp"

namespace multipanda {

// Sends set-points to a running scene by packets over its live-input socket.
class LiveInputChannel final : public SetPointChannel {
 public:
  explicit LiveInputChannel(const std::filesystem::path& socket);

  std::vector<Arm> arms(const std::vector<std::string>& names) override;
  Stream open(const std::string& controllet, const std::string& input, Quantity quantity) override;
  bool send(Stream stream, std::span<const double> values, std::int64_t time_ns) override;
  void rest() override;
  // The run's counts for each stream: received, lost, refused, ... (docs/live_input.md).
  nlohmann::json channels() override;

 private:
  struct Open {
    std::string controllet, input;
    Quantity quantity;
    ReferenceStream packets;
    std::vector<double> newest;
  };
  LiveClient client_;
  std::vector<Open> streams_;
};

}  // namespace multipanda
