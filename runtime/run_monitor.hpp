#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "arm_interface/command_success.hpp"
#include "core/record/cycle_record.hpp"
#include "core/rt/cycle_histogram.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/joints.hpp"
#include "runtime/summary.hpp"

namespace multipanda {

struct ArmStatus {
  std::string arm;
  std::string controllet;                // instance that owns it
  std::optional<double> tracking_error;  // to its set-point; none: it has no set-point
  const char* tracking_unit = "";        // "m" or "rad"
  double torque_use = 0;                 // largest |tau_cmd| / limit of any joint since the last status
  std::uint64_t interventions = 0;       // cycles in which the safety stage intervened, so far
  ArmMode mode = ArmMode::other;
  std::string errors;                              // names of its errors, joined; empty: none
  std::optional<ConnectionStatistics> connection;  // none: simulated in this process
};

// Status of a run, updated a few times per second.
struct RunStatus {
  double time_s = 0;          // loop time
  double elapsed_s = 0;       // wall time
  double rate_hz = 0;         // cycles per second of wall time, since the last status
  double cycle_us = 0;        // median so far
  double cycle_us_worst = 0;  // so far
  std::uint64_t cycles = 0, overruns = 0;
  std::vector<ArmStatus> arms;
  std::uint64_t events = 0;  // so far; the newest are in `news`
  // The first request of the scene (start or timeline) that the loop refused; empty: none.
  std::string refusal;
  std::deque<std::string> news;  // one line per event, newest last; repeated interventions share a line
};

// Keeps status, cycle times and switches of a run from its records, off the loop. The thread that takes the
// records calls take(); any thread may call status().
class RunMonitor {
 public:
  static constexpr std::size_t kNews = 64;  // kept in a status

  // Cycles with an intervention of this rule on this arm, so far. Any thread.
  using Counted = std::function<std::uint64_t(std::size_t arm, Intervention rule)>;

  // `tau_max`: torque limits per arm [N m].
  RunMonitor(RecordLayout layout, std::vector<JointVector> tau_max, Counted counted);

  void take(const CycleRecord& record);
  void take(const Event& event);
  // Adds a line of text to the news. Any thread.
  void add_news(const std::string& text);
  void publish_if_due();  // about ten times per second
  void publish();

  RunStatus status() const;

  // Complete after the run.
  const CycleHistogram& cycle_times() const { return cycle_times_; }
  const std::vector<SwitchReport>& switches() const { return switches_; }
  std::uint64_t commands_missed(std::size_t arm) const { return success_[arm].missed(); }
  const std::vector<InterventionReport>& interventions() const { return interventions_; }

 private:
  static constexpr std::chrono::milliseconds kPeriod{100};

  ArmStatus arm_status(std::size_t arm) const;
  std::optional<double> output_error(std::size_t arm, std::string_view suffix) const;
  void note_refusal(const Event& event);
  void add_switch(const Event& event);
  void add_intervention(const Event& event);
  struct News {
    std::string text;
    std::size_t arm = 0;
    Intervention rule = Intervention::none;  // its count is appended
  };
  void add(LoopTime t, const std::string& text, std::size_t arm = 0, Intervention rule = Intervention::none);
  std::vector<std::string> instance_names(std::uint64_t bits) const;
  std::string arm_names(std::uint32_t bits) const;
  std::string instance_name(std::uint16_t index) const;

  std::vector<CommandSuccess> success_;  // per arm
  const RecordLayout layout_;
  const std::vector<JointVector> tau_max_;
  const Counted counted_;
  CycleRecord last_;
  std::uint64_t cycles_ = 0;
  std::vector<double> torque_use_;  // since the last status
  CycleHistogram cycle_times_;
  std::vector<SwitchReport> switches_;
  std::vector<InterventionReport> interventions_;
  std::deque<News> news_;
  std::string refusal_;
  std::uint64_t events_ = 0;

  std::chrono::steady_clock::time_point begin_, published_;
  std::uint64_t cycles_published_ = 0;
  mutable std::mutex mutex_;
  RunStatus status_;                 // guarded by mutex_, as the next
  std::vector<std::string> posted_;  // from add_news(), not yet in news_
};

}  // namespace multipanda
