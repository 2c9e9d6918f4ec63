#pragma once

#include <cstdint>
#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <multipanda_msgs/msg/event.hpp>
#include <multipanda_msgs/msg/loop_statistics.hpp>
#include <multipanda_msgs/msg/switch.hpp>
#include <mutex>
#include <optional>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "logs/event_text.hpp"
#include "ros/adapter/topic.hpp"

namespace multipanda::ros {

// Timing of the loop since the last call of look(), computed from records. One thread.
class LoopWindow {
 public:
  // Number of cycles whose times are kept; a longer window keeps the newest.
  static constexpr std::size_t kKept = 1 << 16;

  struct Durations {  // [s]; NaN: none
    double median = 0, p99 = 0, worst = 0;
  };
  struct Figures {
    double window_s = 0;  // on the computer's clock
    std::uint64_t cycle = 0, cycles = 0;
    double rate_hz = 0;    // 0: fewer than two cycles
    Durations period;      // start of a cycle to start of the next, on the computer's clock
    Durations cycle_time;  // work of a cycle
    std::uint64_t overruns = 0, overruns_window = 0;
  };

  LoopWindow();
  void add(const CycleRecord& record);
  Figures finish();  // starts a new window with the newest record

 private:
  static Durations durations(std::vector<double>& values);
  void keep(std::vector<double>& values, double value) const;

  std::vector<double> periods_, cycle_times_;
  std::uint64_t added_ = 0;  // in this window
  bool any_ = false;
  bool counts_first_ = true;                        // in the first window, the first cycle completes no
                                                    // period
  std::uint64_t first_cycle_ = 0, last_cycle_ = 0;  // the first is the last one of the previous window
  HostTime first_start_, last_start_;
  std::uint64_t first_overruns_ = 0, last_overruns_ = 0;
};

// Publishes ~/loop_statistics, ~/switch_events and ~/events.
class LoopTopics : public AdapterPart {
 public:
  explicit LoopTopics(const AdapterContext& run);
  void take(const CycleRecord& record) override;
  void take(const Event& event) override;
  // Diagnostics of the loop, each arm and publishing.
  std::vector<Diagnostic> diagnostics() const override;

 private:
  struct Newest {
    bool any = false;
    HostTime start;
    LoopWindow::Figures figures;  // of the last complete window
    std::vector<ArmSample> arms;
  };
  Diagnostic about_loop(const Newest& newest) const;
  Diagnostic about_arm(std::size_t arm, const Newest& newest) const;
  Diagnostic about_publishing() const;
  void publish(const LoopWindow::Figures& figures, const CycleRecord& record);

  const AdapterContext& run_;
  EventText text_;
  LoopWindow window_;
  RateDivider every_, every_window_;
  std::optional<Publisher<multipanda_msgs::msg::LoopStatistics>> statistics_;
  Publisher<multipanda_msgs::msg::Switch> switches_;
  Publisher<multipanda_msgs::msg::Event> events_;
  mutable std::mutex mutex_;
  Newest newest_;  // guarded by mutex_
};

// Publishes /diagnostics at a wall-clock rate, even without new records.
class DiagnosticsTopic : public AdapterPart {
 public:
  explicit DiagnosticsTopic(const AdapterContext& run);
  ~DiagnosticsTopic() override;

 private:
  void publish();
  const AdapterContext& run_;
  std::optional<Publisher<diagnostic_msgs::msg::DiagnosticArray>> publisher_;
  std::optional<Executor::TimerId> timer_;
};

}  // namespace multipanda::ros
