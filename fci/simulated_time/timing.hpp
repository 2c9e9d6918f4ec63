#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <vector>

// Times of a run in simulated time: whole nanoseconds. Random parts are drawn from the seed.
namespace multipanda::fci {

// Evenly distributed from `least` to `least + spread`.
struct DrawnTime {
  std::int64_t least_ns = 0, spread_ns = 0;
};

// One direction of an arm's network.
struct LinkTiming {
  DrawnTime delay{.least_ns = 40'000, .spread_ns = 40'000};
  double loss = 0;  // fraction of datagrams that are lost
};

// Treatment of an answer that is late. Franka documents that it is not used, but publishes no times: both
// behaviors are ours and are tested.
enum class LateAnswers : std::uint8_t {
  dropped,
  taken_next  // in the next period, unless that has its own answer
};

// The torque tau_J_d that an arm shows in a torque motion before its first command, and the reference for
// that command's rate. Franka documents that a motion begins at zero; what is shown is unknown. Tests
// cover both.
enum class FirstTorque : std::uint8_t {
  zero,
  of_own_hold  // of the arm's own hold
};

struct ArmTiming {
  std::int64_t phase_ns = 0;  // delay of its first state after the world's first step; 0 to 1 ms
  double drift_ppm = 0;       // positive: its clock is fast, and it sends more often
  std::uint64_t first_number = 1;
  LinkTiming to_client, to_arm;
};

// Durations in the program from a state's arrival to its answer.
struct ClientTiming {
  DrawnTime wake{.least_ns = 5'000, .spread_ns = 25'000};       // until a sleeping program reads
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
  int version = 0;  // of the protocol; 0: the newest that the arm accepts
  DrawnTime request{.least_ns = 200'000, .spread_ns = 800'000};  // one way of a request or its reply
  double silence_s = 0.02;    // an empty cycle after this time without a state
  double lost_after_s = 1.0;  // an arm silent for this long counts as disconnected
  double request_timeout_s = 1.0;
};

// Numbers from a seed, the same on every computer: the standard's distributions may differ between libraries.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  // 0 <= x < 1
  double unit() { return static_cast<double>(random_() >> 11) * 0x1.0p-53; }
  bool happens(double share) { return unit() < share; }
  double between(double low, double high) { return low + (high - low) * unit(); }
  // 0 to n - 1
  std::uint64_t below(std::uint64_t n) { return static_cast<std::uint64_t>(unit() * static_cast<double>(n)); }
  std::int64_t time(const DrawnTime& t) {
    return t.least_ns + static_cast<std::int64_t>(unit() * static_cast<double>(t.spread_ns));
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace multipanda::fci
