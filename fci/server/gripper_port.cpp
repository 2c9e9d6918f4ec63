#include "fci/server/gripper_port.hpp"

#include "core/cycle/requests.hpp"

namespace multipanda::fci {
namespace {

constexpr std::uint16_t kTemperature = 30;  // [deg C] of an idle hand

}  // namespace

EndEffectorPort::Served GripperPort::serve(const Message& message) {
  using What = Served::What;
  const auto motion = [this](const auto& request) { return Served{What::motion, gripper_.start(request)}; };
  switch (static_cast<GripperCommand>(message.command)) {
    case GripperCommand::homing: {
      GripperHomingRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      return motion(GripperHoming{});
    }
    case GripperCommand::move: {
      GripperMoveRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const GripperMove move{r.width, r.speed};
      return check(move).empty() ? motion(move) : Served{What::refused};
    }
    case GripperCommand::grasp: {
      GripperGraspRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const GripperGrasp grasp{r.width, r.speed, r.force, r.epsilon_inner, r.epsilon_outer};
      return check(grasp).empty() ? motion(grasp) : Served{What::refused};
    }
    case GripperCommand::stop: {
      GripperStopRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      gripper_.stop();
      return {What::done};
    }
    case GripperCommand::connect:
      break;
  }
  return {};
}

std::size_t GripperPort::encode_state(std::uint32_t message_id, std::span<std::byte> to) const {
  const auto& state = gripper_.state();
  return encode_gripper(GripperState{message_id, state.width, state.max_width, state.grasped, kTemperature},
                        to);
}

}  // namespace multipanda::fci
