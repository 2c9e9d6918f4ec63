#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/rt/thread_setup.hpp"
#include "core/types/codes.hpp"
#include "core/types/time.hpp"
#include "runtime/reflex_report.hpp"

namespace multipanda {

// One change of the active controllets, or a refused one.
struct SwitchReport {
  struct Step {
    std::string arm;
    double wanted_nm = 0, sent_nm = 0;  // largest joint: as computed, and after the rate limit
  };
  LoopTime t;
  std::uint64_t cycle = 0;
  std::string cause;  // "start", "timeline", "request", or the rule that took a controllet out
  Verdict verdict = Verdict::accepted;
  std::vector<std::string> started, stopped, kept;
  // On the computer's clock: request received to the cycle that took it; from there to the first torque out.
  // 0 for what the loop did by itself.
  double waiting_us = 0, computing_us = 0;
  std::vector<Step> steps;  // of the arms that changed hands

  bool accepted() const { return verdict == Verdict::accepted; }
};

struct InterventionReport {
  std::string arm;
  Intervention rule = Intervention::none;
  std::uint64_t count = 0;
  double first_s = 0;      // loop time of the first one that was noted
  std::string controllet;  // that it concerned then

  // Cutting a torque, or stopping when asked to, is ordinary work; everything else takes a controllet out.
  bool takes_out() const {
    return rule != Intervention::torque_clamped && rule != Intervention::torque_rate_clamped &&
           rule != Intervention::stop_requested;
  }
};

// Why a run ended.
enum class RunEnd { duration, stopped, backend };
std::string_view to_string(RunEnd end);

// All about a run that is over.
struct RunSummary {
  struct CycleTimes {
    double median = 0, p99 = 0, p999 = 0, worst = 0;
  };
  std::string scene;
  std::string backend;  // what drove the arms: "mujoco", "left fci 172.16.0.2, right mujoco"
  RunEnd end = RunEnd::duration;
  bool paced = true;
  std::uint64_t cycles = 0, overruns = 0;
  double time_s = 0;     // of the loop
  double elapsed_s = 0;  // on the wall
  CycleTimes cycle_us;
  std::vector<SwitchReport> switches;
  std::vector<InterventionReport> interventions;  // per arm and rule
  std::vector<ReflexReport> reflexes;             // arms that stopped themselves, and why
  std::uint64_t records_lost = 0;                 // cycles that are not in the log
  std::vector<std::string> missing;               // what the log lacks, in words; empty: complete, or no log
  std::filesystem::path log;                      // empty: none
  std::filesystem::path report;                   // empty: none
  std::vector<SetupStep> thread;
  std::vector<std::string> problems;  // whatever else went wrong, in words
  // Interventions that were wanted, as (arm, rule): a demonstration of faults is no failed run.
  std::vector<std::pair<std::string, Intervention>> wanted_interventions;

  double rate_hz() const { return elapsed_s > 0 ? static_cast<double>(cycles) / elapsed_s : 0; }
  // A run that went as asked: no controllet was taken out, no switch refused, no log incomplete, no problem.
  bool success() const;
  std::vector<std::string> faults() const;  // why not, one sentence each
};

// One object, as docs/command_line.md describes it.
std::string to_json(const RunSummary& summary);

// "3.000 s: left_joints takes over, left_impedance leaves", without the time.
std::string describe(const SwitchReport& change);

}  // namespace multipanda
