#pragma once

#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <multipanda_msgs/msg/event.hpp>
#include <multipanda_msgs/msg/loop_statistics.hpp>
#include <multipanda_msgs/msg/switch.hpp>
#include <mutex>
#include <optional>
#include <vector>

#include "logs/event_words.hpp"
#include "ros/adapter/state/loop_window.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {

// ~/loop_statistics, ~/switch_events, ~/events.
class LoopTopics : public Part {
 public:
  explicit LoopTopics(const AdapterWorld& world);
  void take(const CycleRecord& record) override;
  void take(const Event& event) override;
  // The loop, each arm, publishing.
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

  const AdapterWorld& world_;
  EventWords words_;
  LoopWindow window_;
  Every every_, every_window_;
  std::optional<Publisher<multipanda_msgs::msg::LoopStatistics>> statistics_;
  Publisher<multipanda_msgs::msg::Switch> switches_;
  Publisher<multipanda_msgs::msg::Event> events_;
  mutable std::mutex mutex_;
  Newest newest_;  // guarded by mutex_
};

// /diagnostics, on the wall clock's time: also while no record comes.
class DiagnosticsTopic : public Part {
 public:
  explicit DiagnosticsTopic(const AdapterWorld& world);
  ~DiagnosticsTopic() override;

 private:
  void publish();
  const AdapterWorld& world_;
  std::optional<Publisher<diagnostic_msgs::msg::DiagnosticArray>> publisher_;
  std::optional<Executor::TimerId> timer_;
};

}  // namespace multipanda::ros
