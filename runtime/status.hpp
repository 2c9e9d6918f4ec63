#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/joints.hpp"
#include "fci/client/arm_statistics.hpp"
#include "runtime/cycle_histogram.hpp"
#include "runtime/summary.hpp"

namespace multipanda {

struct ArmStatus {
  std::string arm;
  std::string controllet;                // instance that owns it
  std::optional<double> tracking_error;  // of its set-point; none: it has no set-point
  const char* tracking_unit = "";        // "m" or "rad"
  double torque_use = 0;                 // largest |tau_cmd| / limit of any joint since the last status
  std::uint64_t interventions = 0;       // of the safety stage, so far
  std::string last_intervention;         // its rule; empty: none
  ArmMode mode = ArmMode::other;
  std::optional<fci::ArmStatistics> link;  // how its packets fare; none: simulated in this process
};

// What a run is doing, a few times per second.
struct RunStatus {
  double time_s = 0;          // of the loop
  double elapsed_s = 0;       // on the wall
  double rate_hz = 0;         // cycles per second on the wall, since the last status
  double cycle_us = 0;        // median so far
  double cycle_us_worst = 0;  // so far
  std::uint64_t cycles = 0, overruns = 0;
  std::vector<ArmStatus> arms;
  std::uint64_t events = 0;      // so far; the newest are in `news`
  std::deque<std::string> news;  // what happened, in words, newest last
};

// Follows a run by its records, off the loop: keeps the status, the cycle times, the switches. The thread
// that takes the records calls take(); status() may be called by any.
class StatusBoard {
 public:
  static constexpr std::size_t kNews = 64;  // kept in a status

  // `tau_max`: torque limits, per arm.
  StatusBoard(RecordLayout layout, std::vector<JointVector> tau_max);

  void take(const CycleRecord& record);
  void take(const Event& event);
  // What somebody else has to say, in words. Any thread.
  void say(const std::string& text);
  void publish_if_due();  // about ten times per second
  void publish();

  RunStatus status() const;

  // When the run is over.
  const CycleHistogram& cycle_times() const { return cycle_times_; }
  const std::vector<SwitchReport>& switches() const { return switches_; }
  const std::vector<InterventionReport>& interventions() const { return interventions_; }

 private:
  static constexpr std::chrono::milliseconds kPeriod{100};

  ArmStatus arm_status(std::size_t arm) const;
  std::optional<double> output_error(std::size_t arm, std::string_view suffix) const;
  void add_switch(const Event& event);
  void add_intervention(const Event& event);
  void tell(const Event& event, const std::string& text) { tell(event.t, text); }
  void tell(LoopTime t, const std::string& text);
  std::vector<std::string> instance_names(std::uint64_t bits) const;
  std::string arm_names(std::uint32_t bits) const;
  std::string instance_name(std::uint16_t index) const;

  const RecordLayout layout_;
  const std::vector<JointVector> tau_max_;
  CycleRecord last_;
  std::uint64_t cycles_ = 0;
  std::vector<double> torque_use_;  // since the last status
  std::vector<std::string> last_intervention_;
  CycleHistogram cycle_times_;
  std::vector<SwitchReport> switches_;
  std::vector<InterventionReport> interventions_;
  std::deque<std::string> news_;
  std::uint64_t events_ = 0;

  std::chrono::steady_clock::time_point begin_, published_;
  std::uint64_t cycles_published_ = 0;
  mutable std::mutex mutex_;
  RunStatus status_;               // guarded by mutex_, as the next
  std::vector<std::string> said_;  // not told yet
};

}  // namespace multipanda
