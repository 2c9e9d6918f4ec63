#include "fci/server/vacuum_port.hpp"

#include <cmath>

namespace multipanda::fci {
namespace {

constexpr std::uint8_t kProfiles = 4;
double seconds(std::int64_t milliseconds) { return 1e-3 * static_cast<double>(milliseconds); }

}  // namespace

EndEffectorPort::Served VacuumPort::serve(const Message& message) {
  using What = Served::What;
  switch (static_cast<VacuumCommand>(message.command)) {
    case VacuumCommand::vacuum: {
      VacuumRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const VacuumOn on{10.0 * r.vacuum, seconds(r.timeout)};
      if (r.profile >= kProfiles || !SimulatedVacuum::check(on).empty()) return {What::refused};
      return {What::motion, vacuum_.start(on)};
    }
    case VacuumCommand::drop_off: {
      VacuumDropOffRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const VacuumDrop drop{seconds(r.timeout)};
      if (!SimulatedVacuum::check(drop).empty()) return {What::refused};
      return {What::motion, vacuum_.start(drop)};
    }
    case VacuumCommand::stop: {
      VacuumStopRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      vacuum_.stop();
      return {What::done};
    }
    case VacuumCommand::connect:
      break;
  }
  return {};
}

std::size_t VacuumPort::encode_state(std::uint32_t message_id, std::span<std::byte> to) const {
  const SimulatedVacuum::State& state = vacuum_.state();
  return encode_gripper(VacuumState{.message_id = message_id,
                                    .in_control_range = state.in_control_range,
                                    .part_detached = state.part_detached,
                                    .part_present = state.part_present,
                                    .actual_power = state.power_percent,
                                    .vacuum = static_cast<std::int32_t>(std::lround(state.vacuum_mbar))},
                        to);
}

}  // namespace multipanda::fci
