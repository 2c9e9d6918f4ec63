#pragma once

#include <functional>
#include <map>
#include <optional>
#include <regex>
#include <string>
#include <vector>

#include "benchmarks/loops.hpp"
#include "core/modes/registry.hpp"
#include "core/rt/thread_setup.hpp"

namespace multipanda::bench {

// Statistics of a series of measurements.
struct Figures {
  double median = 0, p999 = 0, worst = 0;  // p999: 99.9 % quantile (nearest rank)
};
Figures figures_of(std::vector<double> values);  // not empty

// A repeatedly timed operation.
struct Case {
  std::string name;  // "cycle_us/hold/1"
  std::function<void()> once;
  std::function<void()> verify;     // called afterwards: throws if the case did not run as intended; may be
                                    // empty
  std::vector<double> durations{};  // [us]
};

// Selects the cases whose name contains a match. Throws std::regex_error.
class Filter {
 public:
  explicit Filter(const std::string& expression) : expression_(expression) {}
  bool operator()(const std::string& name) const { return std::regex_search(name, expression_); }

 private:
  std::regex expression_;
};

// Times every case `samples` times, in alternation: a block of each, then the next block of each, so that
// other load affects all of them equally. Within a block caches are warm except for its first calls, which
// count. Ends after a complete round when `budget_s` is over.
void measure_in_turns(std::vector<Case>& cases, std::size_t samples, double budget_s);

// One whole ControlCycle::step over SmoothMotion per call. "cycle_us/<controllet>/<arms>" for every
// registered controllet and every suitable number of arms, each arm or pair under its own instance;
// "cycle_us/<controllet>+<feature>/2" for every registered feature.
std::vector<Case> cycle_cases(const Arms& arms, const Registry& registry, const Filter& selected);

struct RealtimeFactor {
  std::string name;   // "2"; "2+features": with collision avoidance and manipulability
  double factor = 0;  // simulated time over wall-clock time, median of the chunks
};
// `chunks` chunks of `cycles` control cycles each, in alternation. Ends after a complete round once
// `budget_s` is over.
std::vector<RealtimeFactor> measure_realtime_factor(const Registry& registry, std::size_t chunks,
                                                    std::size_t cycles, double budget_s,
                                                    const Filter& selected);

// The libraries alone, over the same states as the control cycle: "limits_us/pinocchio_terms",
// "limits_us/dual_cartesian_impedance", "limits_us/mj_step/<arms>".
// Throws std::runtime_error if the torques of the bare two-arm math and of the controllet differ by more
// than 1e-9 N m, because their times could not be compared.
std::vector<Case> bare_cases(const Arms& arms, const Registry& registry, const Filter& selected);

// The cost of features where they act: "features_us/none", "features_us/collision_avoidance", ... each one
// whole ControlCycle::step of DC over two arms whose hands nearly meet, above a floor. At every state at
// least three pairs of shapes are nearer than 0.05 m, and the manipulability of both arms is below 0.1;
// throws std::runtime_error otherwise. "collision_avoidance+hulls": both bases have six hulls of 32 corners,
// whose distances from most links have to be computed.
std::vector<Case> feature_cases(const Registry& registry, const Filter& selected);

// Heap and lock calls in 10,000 such steps, with the same names without the section.
struct LoopCalls {
  std::uint64_t heap = 0, locks = 0;
};
std::map<std::string, LoopCalls> count_feature_calls(const Registry& registry, const Filter& selected);

struct SwitchTimes {
  std::map<std::string, std::vector<double>> trials_ms;  // "controllet", "feature"
  std::vector<SetupStep> loop_thread;                    // scheduling granted to the loop's thread
};

// Runs two arms at 1 kHz in a separate thread. Another thread sends requests at random moments, seeded: for
// two Cartesian impedances and DC alternately, and for joint_limits on and off. A trial lasts from just
// before the request is sent until just after its first torque is written. Throws std::runtime_error if a
// request is refused or not answered within a second.
SwitchTimes measure_switching(const Arms& arms, const Registry& registry, std::size_t trials,
                              const Filter& selected);

struct RosTimes {
  std::vector<double> switch_ms;            // one per trial
  std::vector<double> adapter_us;           // one per cycle: the adapter's time in the loop's thread
  std::vector<double> with_us, without_us;  // cycle times of the run with the adapter and of one without
  std::string missing;                      // reason if there are no results: not built, ...
};

// Runs two simulated arms (the scene two_arms) at 1 kHz with the ROS adapter. A client process switches by
// the service ~/switch_controllets at seeded random moments, alternating between two Cartesian impedances
// and DC. A trial lasts from just before the client sends the request until the loop has written the first
// torque of the new controllets, both on this computer's steady clock. Cycle times come
// from three runs with the adapter and three without, in turns.
RosTimes measure_ros(const Registry& registry, std::size_t trials);

}  // namespace multipanda::bench
