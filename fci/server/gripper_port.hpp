#pragma once

#include "backends/gripper/simulated_gripper.hpp"
#include "fci/server/end_effector_port.hpp"

namespace multipanda::fci {

// The parallel gripper of one virtual arm at its own port (1338), like that of the Franka Hand.
class GripperPort final : public EndEffectorPort {
 public:
  GripperPort(std::string name, std::string address, std::uint16_t port, SimulatedGripper& gripper)
      : EndEffectorPort(std::move(name), std::move(address), port, kMaxGripperRequestSize),
        gripper_(gripper) {}

 protected:
  Served serve(const Message& message) override;
  GripperResult result(Ticket ticket) const override { return gripper_.result(ticket); }
  std::size_t encode_state(std::uint32_t message_id, std::span<std::byte> to) const override;
  std::uint16_t version() const override { return kGripperVersion; }

 private:
  SimulatedGripper& gripper_;
};

}  // namespace multipanda::fci
