#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

// The state of an arm's control interface, read without commands.
struct ArmStreamReading {
  std::string address;
  std::string reason;                                   // why there is no connection; empty: connected
  int version = 0;                                      // agreed version of the protocol
  std::string mode;                                     // "idle", "reflex", ...
  std::string errors;                                   // names of active errors; empty: none
  double seconds = 0;                                   // duration of listening
  std::uint64_t states = 0, lost = 0, lost_in_row = 0;  // by the arm's sequence numbers
  // Lost states that arrived, but this computer woke so late that a newer one was already there.
  std::uint64_t outdated = 0;
  std::vector<double> gaps_us;  // between the arrivals of two states
};
// Connects, listens and closes, without any command. The control interface serves one program at a time, so
// no other program can be connected meanwhile.
ArmStreamReading read_arm_stream(const std::string& address, double seconds);

Finding judge_arm_version(const ArmStreamReading& reading, Purpose purpose);
Finding judge_state_stream(const ArmStreamReading& reading, Purpose purpose);

// "Franka Research 3, system 5.9 or later": the arms that use a version of the protocol.
std::string arms_of_version(int version);

// An arm under torque control with zero torque: it compensates gravity and yields when pushed.
struct CommunicationReading {
  std::string address;
  int version = 0;
  double asked_s = 0;                       // requested duration by the arm's clock
  std::uint64_t periods = 0;                // of the arm during the test
  std::uint64_t answered = 0;               // states answered by a torque
  std::uint64_t lost = 0, lost_in_row = 0;  // states that were lost or too late to be answered
  std::uint64_t not_sent = 0;               // torques that could not be sent
  // The arm's success rate over its last 100 periods, from period 500 on, when its window is full.
  double success_min = 1, success_sum = 0;
  std::uint64_t success_count = 0;
  std::vector<double> cycle_us;   // between the arrivals of two states
  std::vector<double> answer_us;  // from the arrival of a state to the sending of its torque
  std::string ended;              // why the test ended early; empty: complete
  std::string errors;             // names of the arm's errors at that time
  double success_average() const {
    return success_count > 0 ? success_sum / static_cast<double>(success_count) : 0;
  }
};

// Runs the test: connects, starts torque control, answers each state with zero torque for `seconds` of the
// arm's time, ends the motion. Calls `keep_on` once per period. Throws std::runtime_error if the motion
// cannot be started; later faults are in the reading.
CommunicationReading run_communication_test(const std::string& address, double seconds,
                                            const std::function<bool()>& keep_on);

std::vector<Finding> judge_communication(const CommunicationReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
