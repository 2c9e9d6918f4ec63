#include <cmath>

#include "core/cycle/requests.hpp"
#include "fci/client/end_effector.hpp"
#include "fci/client/end_effector_connection.hpp"
#include "fci/wire/gripper.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci {
namespace {

constexpr double kReply = 5.0;      // for requests that are answered at once [s]
constexpr double kHoming = 60.0;    // [s]
constexpr double kLongest = 600.0;  // of a motion; the arm's own clock may stop in lock-step [s]

class GripperProtocol final : public EndEffectorProtocol {
 public:
  bool is_vacuum() const override { return false; }
  std::uint16_t version() const override { return kGripperVersion; }

  std::size_t encode(const GripperRequest& request, std::uint32_t id, std::span<std::byte> to,
                     std::string& why) const override {
    if (std::holds_alternative<GripperHoming>(request)) {
      return encode_gripper_request(id, GripperHomingRequest{}, to);
    }
    if (std::holds_alternative<GripperStop>(request)) {
      return encode_gripper_request(id, GripperStopRequest{}, to);
    }
    why = check(request);
    if (const auto* move = std::get_if<GripperMove>(&request)) {
      return encode_gripper_request(id, GripperMoveRequest{move->width, move->speed}, to);
    }
    if (const auto* grasp = std::get_if<GripperGrasp>(&request)) {
      return encode_gripper_request(id,
                                    GripperGraspRequest{grasp->width, grasp->tolerance_inner,
                                                        grasp->tolerance_outer, grasp->speed, grasp->force},
                                    to);
    }
    return 0;
  }

  double patience_s(const GripperRequest& request) const override {
    if (std::holds_alternative<GripperHoming>(request)) return kHoming;
    return std::holds_alternative<GripperStop>(request) ? kReply : kLongest;
  }

  std::uint32_t decode_state(std::span<const std::byte> datagram,
                             multipanda::GripperState& state) const override {
    GripperState packet;
    if (decode_gripper(datagram, packet, false) != WireResult::ok) return 0;
    state.width = packet.width;
    state.max_width = packet.max_width;
    state.grasped = packet.is_grasped;
    return packet.message_id;
  }
};

class VacuumProtocol final : public EndEffectorProtocol {
 public:
  bool is_vacuum() const override { return true; }
  std::uint16_t version() const override { return kVacuumVersion; }

  std::size_t encode(const GripperRequest& request, std::uint32_t id, std::span<std::byte> to,
                     std::string& why) const override {
    why = check(request);
    if (!why.empty()) return 0;
    const auto milliseconds = [](double seconds) { return std::int64_t{std::llround(1000 * seconds)}; };
    if (const auto* on = std::get_if<VacuumOn>(&request)) {
      const auto steps = static_cast<std::uint8_t>(std::lround(on->pressure_mbar / 10));
      return encode_gripper_request(
          id, VacuumRequest{.vacuum = steps, .timeout = milliseconds(on->timeout_s)}, to);
    }
    if (const auto* drop = std::get_if<VacuumDrop>(&request)) {
      return encode_gripper_request(id, VacuumDropOffRequest{milliseconds(drop->timeout_s)}, to);
    }
    if (std::holds_alternative<VacuumStop>(request)) {
      return encode_gripper_request(id, VacuumStopRequest{}, to);
    }
    return 0;
  }

  double patience_s(const GripperRequest& request) const override {
    return std::holds_alternative<VacuumStop>(request) ? kReply : kLongest;
  }

  std::uint32_t decode_state(std::span<const std::byte> datagram,
                             multipanda::GripperState& state) const override {
    VacuumState packet;
    if (decode_gripper(datagram, packet, false) != WireResult::ok) return 0;
    state.grasped = packet.part_present;
    return packet.message_id;
  }
};

}  // namespace

std::unique_ptr<EndEffector> gripper_link(const std::string& name, const std::string& address,
                                          std::uint16_t port) {
  return std::make_unique<EndEffectorConnection>("the gripper of arm " + name, address, port,
                                                 std::make_unique<GripperProtocol>());
}

std::unique_ptr<EndEffector> vacuum_link(const std::string& name, const std::string& address,
                                         std::uint16_t port) {
  return std::make_unique<EndEffectorConnection>("the vacuum gripper of arm " + name, address, port,
                                                 std::make_unique<VacuumProtocol>());
}

}  // namespace multipanda::fci
