#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "core/rt/thread_setup.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

struct ExaminationOptions {
  std::vector<std::string> addresses;  // of arms
  std::string scene;                   // whose control cycle is timed
  double seconds = 10;                 // of each measurement
  std::optional<Purpose> purpose;      // of the computer; none: by the addresses
};

// Real arms if an address belongs to another computer.
Purpose purpose_of(const std::vector<std::string>& addresses);

// Runs all examinations in order and shows each finding at once. Moves no arm. Takes about (1 + 2 * arms)
// times `seconds`. Unreadable quantities become findings, not exceptions.
std::vector<Finding> examine(const ExaminationOptions& options,
                             const std::function<void(const Finding&)>& show);

// Lateness of a thread with the loop's set-up that wakes once per millisecond.
struct TimerReading {
  std::vector<double> late_us;      // one per wake-up
  std::uint64_t missed = 0;         // missed periods
  std::uint64_t missed_in_row = 0;  // largest number of successive ones
  std::vector<SetupStep> setup;     // results of the thread's set-up
};
// Takes `seconds`. Nothing else runs in this process meanwhile.
TimerReading read_timer(double seconds);

inline constexpr double kPeriod_us = 1000;  // of an arm
// Latest arrival of a torque: an arm waits about 0.3 ms for the answer to its state.
inline constexpr double kAnswerLimit_us = 300;
// Number of successive periods without a torque that stops an arm.
inline constexpr std::uint64_t kLostInRowLimit = 20;

Finding judge_timer(const TimerReading& reading, Purpose purpose);

// The cost of a scene's control cycle on this computer, and forbidden operations in it.
struct ControlCycleReading {
  std::string scene;
  std::string reason;  // why it was not measured; empty: measured
  std::uint64_t cycles = 0;
  double p50 = 0, p99 = 0, p999 = 0, worst = 0;  // [us], without the simulator's own step
  bool guarded = false;                          // calls were counted, not only page faults
  bool memory_locked = false;                    // otherwise page faults are expected
  std::uint64_t heap_calls = 0, lock_calls = 0, page_faults = 0;
  // Interruptions of the measuring thread: many of them explain a slow worst cycle.
  std::uint64_t interruptions = 0;
};
// Runs the simulated scene unpaced for some thousand cycles in a separate program, which counts heap calls
// and locks.
ControlCycleReading read_control_cycle(const std::string& scene, std::uint64_t cycles);
// Parses the output of that program. Throws std::runtime_error if it is invalid.
ControlCycleReading parse_control_cycle(const std::string& json);

Finding judge_control_cycle(const ControlCycleReading& reading, Purpose purpose);
Finding judge_loop_guard(const ControlCycleReading& reading, Purpose purpose);

// The network card on the route to an arm, and its counters of dropped and damaged packets.
struct NetworkCardReading {
  std::string address;    // of the arm
  std::string interface;  // "eth0"; empty: no route
  std::string reason;     // why there is no route
  bool loopback = false, wireless = false, usb = false, virtual_card = false;
  std::string gateway;          // of the route; empty: the arm is on the same network
  std::optional<double> mtu;    // [bytes]
  std::optional<double> speed;  // [Mbit/s]
  bool full_duplex = true;
  std::optional<double> coalesce_us;  // delay of the card's notification of a packet
  double damaged = 0, dropped = 0;    // packets since the card was started
};
NetworkCardReading read_network_card(const std::string& address, const SystemFiles& files);

Finding judge_network_card(const NetworkCardReading& reading, Purpose purpose);

// Round-trip time of a packet to the arm's control unit, without a request to the arm.
struct RoundTripReading {
  std::string address;
  std::string method;  // "ICMP echo of 1200 bytes"; empty: none was possible
  std::string reason;  // why not
  std::vector<double> us;
  std::size_t sent = 0;
};
// Sends echo requests of the size of the arm's packets at 1 kHz for `seconds`. If this user may not send
// them, it measures the time to open a connection to the control port ten times.
RoundTripReading read_round_trip(const std::string& address, double seconds);

// Franka's limit of the round trip.
inline constexpr double kRoundTripLimit_us = 300;

Finding judge_round_trip(const RoundTripReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
