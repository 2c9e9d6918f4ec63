#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "backends/gripper/simulated_gripper.hpp"
#include "backends/gripper/simulated_vacuum.hpp"
#include "fci/server/sockets.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/gripper.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci {

// Base of the ports of gripper and vacuum gripper: one program at a time, requests over TCP that are
// answered when the motion is over, states over UDP. A second program is refused while the first is
// connected. A program that violates the protocol loses its connection. A motion continues after its
// program has disconnected.
//
// One thread; nothing blocks; stepped() does not allocate.
class EndEffectorPort : public Port {
 public:
  // `name`: of the arm, for messages. `port` 0: a free one.
  EndEffectorPort(std::string name, std::string address, std::uint16_t port, std::size_t max_request);
  ~EndEffectorPort() override;

  void open(Poll& poll) override;
  void ready(int file, std::uint32_t events) override;
  void stepped(std::int64_t period) override;

  std::uint16_t port() const { return port_; }  // the actual port, after open()
  void close_connection();

  // Between two states: 13 Hz, since users of real hands report 12 to 15.
  static constexpr std::int64_t kStatePeriods = 75;

 protected:
  using Ticket = MotionResults::Ticket;
  // Immediate result of a request.
  struct Served {
    enum class What : std::uint8_t { motion, done, refused, nonsense } what = What::nonsense;
    Ticket ticket = 0;
  };
  virtual Served serve(const Message& message) = 0;  // any but Connect, whose number is 0
  virtual GripperResult result(Ticket ticket) const = 0;
  virtual std::size_t encode_state(std::uint32_t message_id, std::span<std::byte> to) const = 0;
  virtual std::uint16_t version() const = 0;

 private:
  struct Client;
  struct Pending {
    std::uint16_t command = 0;
    std::uint32_t command_id = 0;
    Ticket ticket = 0;
  };
  void accept();
  void read_requests();
  bool serve_request(const Message& message);
  bool connect(const Message& message);
  void answer(const Pending& pending, GripperStatus status);
  void answer_finished();
  void publish();

  std::string name_, address_;
  std::uint16_t port_;
  Poll* poll_ = nullptr;
  Socket listener_;
  FrameReader reader_;
  std::unique_ptr<Client> client_;
  std::optional<Pending> pending_;  // at most one: a new motion ends the running one
  std::uint32_t message_id_ = 0;
  std::int64_t state_in_ = 0;  // periods until the next state
};

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
