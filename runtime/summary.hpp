#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/rt/thread_setup.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/codes.hpp"
#include "core/types/time.hpp"
#include "runtime/error_report.hpp"

namespace multipanda {

// One change of the active controllets, or a refused one.
struct SwitchReport {
  struct Step {
    std::string arm;
    double requested_nm = 0,
           sent_nm = 0;  // largest step of a joint: as computed, and as sent after the rate limit
  };
  LoopTime t;
  std::uint64_t cycle = 0;
  std::string cause;  // "start", "timeline", "request", or the rule that deactivated a controllet
  Verdict verdict = Verdict::accepted;
  std::vector<std::string> started, stopped, kept;
  // On the computer's clock: from the request to the cycle that accepted it; from there to the first torque
  // sent. 0 for switches by the loop.
  double waiting_us = 0, computing_us = 0;
  std::vector<Step> steps;  // of the arms whose owner changed

  bool accepted() const { return verdict == Verdict::accepted; }
};

struct InterventionReport {
  std::string arm;
  Intervention rule = Intervention::none;
  std::uint64_t count = 0;     // cycles
  std::uint64_t episodes = 0;  // number of episodes of such cycles, as in logs and reports
  double first_s = 0;          // loop time of the first one
  std::string controllet;      // of the first one

  // Clamped torques and requested stops are normal; all other interventions deactivate the controllet.
  bool deactivates() const {
    return rule != Intervention::torque_clamped && rule != Intervention::torque_rate_clamped &&
           rule != Intervention::stop_requested;
  }
};

// Packets of an arm on the network.
struct ConnectionReport {
  std::string arm;
  ConnectionStatistics packets;
  std::uint64_t commands_missed = 0;  // as reported by the arm
};

// Why a run ended.
enum class RunEnd { duration, stopped, backend };
std::string_view to_string(RunEnd end);

// Results of a finished run.
struct RunSummary {
  struct CycleTimes {
    double median = 0, p99 = 0, p999 = 0, worst = 0;
  };
  std::string scene;
  std::string backend;  // backends of the arms: "mujoco", "left fci 172.16.0.2, right mujoco"
  RunEnd end = RunEnd::duration;
  bool paced = true;
  std::uint64_t cycles = 0, overruns = 0;
  double time_s = 0;     // loop time
  double elapsed_s = 0;  // wall time
  CycleTimes cycle_us;
  std::vector<SwitchReport> switches;
  std::vector<InterventionReport> interventions;  // per arm and rule
  std::vector<ConnectionReport> connections;      // of arms on the network
  std::vector<ReflexReport> reflexes;             // arms that stopped themselves
  std::uint64_t records_lost = 0;                 // cycles missing in the log
  std::vector<std::string> missing;               // one sentence each; empty: complete, or no log
  std::filesystem::path log;                      // empty: none
  std::vector<std::filesystem::path> kept;        // logs of the last 30 s (KeptLogs)
  std::filesystem::path report;                   // empty: none
  std::vector<SetupStep> thread;
  std::vector<std::string> problems;  // other problems, one sentence each
  // Expected interventions as (arm, rule): they do not make a demonstration of faults fail.
  std::vector<std::pair<std::string, Intervention>> expected_interventions;

  double rate_hz() const { return elapsed_s > 0 ? static_cast<double>(cycles) / elapsed_s : 0; }
  // No controllet was deactivated, no switch refused, the log is complete, and there was no other problem.
  bool success() const;
  std::vector<std::string> faults() const;  // reasons of a failure, one sentence each
};

// One object, as docs/command_line.md describes it.
std::string to_json(const RunSummary& summary);

// "left_joints on, left_impedance off".
std::string describe(const SwitchReport& change);

}  // namespace multipanda
