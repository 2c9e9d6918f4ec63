#pragma once

#include <optional>

#include "generators/set_point_link.hpp"
#include "runtime/live_input/client.hpp"

namespace multipanda {

// To a running scene's controllets by packets over its live-input socket.
class LiveLink final : public SetPointLink {
 public:
  explicit LiveLink(const std::filesystem::path& socket);

  std::vector<Arm> arms(const std::vector<std::string>& names) override;
  Stream open(const std::string& controllet, const std::string& input, Quantity quantity) override;
  bool send(Stream stream, std::span<const double> values, std::int64_t time_ns) override;
  void rest() override;
  // What the run says of each stream: received, lost, refused, ... as docs/live_input.md has it.
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
