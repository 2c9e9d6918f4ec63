#pragma once

#include <cstdint>
#include <optional>
#include <vector>

// The times of a run in simulated time: whole nanoseconds. What varies is drawn from the seed.
namespace multipanda::fci {

// Evenly distributed from `least` to `least + spread`.
struct DrawnTime {
  std::int64_t least_ns = 0, spread_ns = 0;
};

// One direction of an arm's network.
struct LinkTiming {
  DrawnTime delay{.least_ns = 40'000, .spread_ns = 40'000};
  double loss = 0;  // share of the datagrams that never arrive
};

// What an arm does with an answer that comes after its time. Franka documents that it is not used, and
// publishes no times: both behaviors are ours, and tests try both.
enum class LateAnswers : std::uint8_t {
  dropped,
  taken_next  // in the next period, unless that has an answer of its own
};

// The torque tau_J_d that an arm shows in a torque motion before it has taken its first command, and from
// which that command counts. Franka documents that a motion begins at zero; what is shown is not known. Tests
// try both.
enum class FirstTorque : std::uint8_t {
  zero,
  of_own_hold  // with which the arm has held itself
};

struct ArmTiming {
  std::int64_t phase_ns = 0;  // of its first state against the world's first step; 0 to 1 ms
  double drift_ppm = 0;       // positive: its clock is fast, and it sends more often
  std::uint64_t first_number = 1;
  LinkTiming to_client, to_arm;
};

// The program: how long it takes from a state's arrival to its answer.
struct ClientTiming {
  DrawnTime wake{.least_ns = 5'000, .spread_ns = 25'000};       // until it reads, when it slept
  DrawnTime compute{.least_ns = 80'000, .spread_ns = 120'000};  // until it has sent
  double stalls_per_s = 0;                                      // before reading, or before sending
  DrawnTime stall{.least_ns = 1'000'000, .spread_ns = 49'000'000};
};

struct SimulatedTimeOptions {
  std::uint64_t seed = 1;
  // By arm. Fewer: phase, drift of up to 50 ppm and first number from the seed.
  std::vector<ArmTiming> arms;
  ClientTiming client;
  LateAnswers late_answers = LateAnswers::dropped;
  FirstTorque first_torque = FirstTorque::zero;
  // From sending a state to the arrival of its answer. Franka names 1 ms for both ways and the computing.
  std::int64_t answer_ns = 1'000'000;
  int version = 0;  // of the protocol; 0: 5 for models named fer, otherwise 10
  DrawnTime request{.least_ns = 200'000, .spread_ns = 800'000};  // one way of a request or its reply
  double silence_s = 0.02;    // an empty cycle after so long without a state
  double lost_after_s = 1.0;  // an arm that is silent for so long counts as disconnected
  double request_timeout_s = 1.0;
};

}  // namespace multipanda::fci
