#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

// An arm under torque control with zero torque: it holds itself against gravity and gives way to a hand.
struct CommunicationReading {
  std::string address;
  int version = 0;
  double asked_s = 0;                       // length, by the arm's own count of periods
  std::uint64_t periods = 0;                // of the arm, while the test ran
  std::uint64_t answered = 0;               // states that got a torque
  std::uint64_t lost = 0, lost_in_row = 0;  // states that never came, or came too late to be answered
  std::uint64_t not_sent = 0;               // torques that this computer's network did not take
  // What the arm says of the last 100 periods; from the 500th on, when the window is full.
  double success_min = 1, success_sum = 0;
  std::uint64_t success_count = 0;
  std::vector<double> cycle_us;   // from one state's arrival to the next one's
  std::vector<double> answer_us;  // from a state's arrival to its torque's departure
  std::string ended;              // why it ended before its time; empty: it did not
  std::string errors;             // of the arm then: names
  double success_average() const {
    return success_count > 0 ? success_sum / static_cast<double>(success_count) : 0;
  }
};

// Runs the test: connects, starts torque control, answers each state with zero torque for `seconds` of the
// arm's time, ends the motion. `keep_on` is asked once per period. Throws std::runtime_error if the motion
// cannot be started; what happens afterwards is in the reading.
CommunicationReading run_communication_test(const std::string& address, double seconds,
                                            const std::function<bool()>& keep_on);

std::vector<Finding> judge_communication(const CommunicationReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
