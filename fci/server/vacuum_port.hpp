#pragma once

#include "backends/gripper/simulated_vacuum.hpp"
#include "fci/server/end_effector_port.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci {

// The vacuum gripper of one virtual arm at its own port (1339).
class VacuumPort final : public EndEffectorPort {
 public:
  VacuumPort(std::string name, std::string address, std::uint16_t port, SimulatedVacuum& vacuum)
      : EndEffectorPort(std::move(name), std::move(address), port, kMaxVacuumRequestSize), vacuum_(vacuum) {}

 protected:
  Served serve(const Message& message) override;
  GripperResult result(Ticket ticket) const override { return vacuum_.result(ticket); }
  std::size_t encode_state(std::uint32_t message_id, std::span<std::byte> to) const override;
  std::uint16_t version() const override { return kVacuumVersion; }

 private:
  SimulatedVacuum& vacuum_;
};

}  // namespace multipanda::fci
