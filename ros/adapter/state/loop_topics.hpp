#pragma once

#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <multipanda_msgs/msg/event.hpp>
#include <multipanda_msgs/msg/loop_statistics.hpp>
#include <multipanda_msgs/msg/switch.hpp>
#include <mutex>
#include <optional>
#include <vector>

#include "logs/event_text.hpp"
#include "ros/adapter/state/loop_window.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {

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
