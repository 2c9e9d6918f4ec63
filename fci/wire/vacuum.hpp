#pragma once

#include "fci/wire/gripper.hpp"

// The vacuum gripper's connection (port kVacuumPort): header, statuses and replies are the gripper's.
namespace multipanda::fci {

enum class VacuumCommand : std::uint16_t { connect, vacuum, drop_off, stop };

struct VacuumConnectRequest {
  static constexpr VacuumCommand kCommand = VacuumCommand::connect;
  std::uint16_t version = kVacuumVersion;
  std::uint16_t udp_port = 0;
};
struct VacuumRequest {
  static constexpr VacuumCommand kCommand = VacuumCommand::vacuum;
  std::uint8_t vacuum = 0;   // set point [10 mbar]
  std::uint8_t profile = 0;  // 0 to 3
  std::int64_t timeout = 0;  // [ms]
};
struct VacuumDropOffRequest {
  static constexpr VacuumCommand kCommand = VacuumCommand::drop_off;
  std::int64_t timeout = 0;  // [ms]
};
struct VacuumStopRequest {
  static constexpr VacuumCommand kCommand = VacuumCommand::stop;
};

enum class VacuumDeviceStatus : std::uint8_t { green, yellow, orange, red };

struct VacuumState {
  std::uint32_t message_id = 0;
  bool in_control_range = false, part_detached = false, part_present = false;
  VacuumDeviceStatus device_status = VacuumDeviceStatus::green;
  std::int32_t actual_power = 0;  // [%]
  std::int32_t vacuum = 0;        // [mbar]
};

constexpr void carry(auto& a, MessageOf<VacuumConnectRequest> auto& r) {
  a.integer("version", r.version);
  a.integer("udp_port", r.udp_port);
}
constexpr void carry(auto& a, MessageOf<VacuumRequest> auto& r) {
  a.integer("vacuum", r.vacuum);
  a.integer("profile", r.profile);
  a.integer("timeout", r.timeout);
}
constexpr void carry(auto& a, MessageOf<VacuumDropOffRequest> auto& r) { a.integer("timeout", r.timeout); }
constexpr void carry(auto&, MessageOf<VacuumStopRequest> auto&) {}
constexpr void carry(auto& a, MessageOf<VacuumState> auto& s) {
  a.integer("message_id", s.message_id);
  a.flag("in_control_range", s.in_control_range);
  a.flag("part_detached", s.part_detached);
  a.flag("part_present", s.part_present);
  a.choice("device_status", s.device_status, VacuumDeviceStatus::red);
  a.integer("actual_power", s.actual_power);
  a.integer("vacuum", s.vacuum);
}

inline constexpr std::size_t kVacuumStateSize = gripper_payload_size<VacuumState>();
static_assert(kVacuumStateSize == 16);
static_assert(kGripperHeader + gripper_payload_size<VacuumConnectRequest>() == 14);
static_assert(kGripperHeader + gripper_payload_size<VacuumRequest>() == 20);
static_assert(kGripperHeader + gripper_payload_size<VacuumDropOffRequest>() == 18);
static_assert(kGripperHeader + gripper_payload_size<VacuumStopRequest>() == 10);
inline constexpr std::size_t kMaxVacuumRequestSize = 20;

}  // namespace multipanda::fci
