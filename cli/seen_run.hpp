#pragma once

#include <set>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "scene/scene.hpp"

namespace multipanda::cli {

bool is_physical(const SceneArm& arm);  // not on this computer

// What a run has shown of its scene on physical arms. It counts as motion that a joint turns by more than
// kMoving under a controllet that takes commands: neither hold nor an arm that is led by hand tells what the
// scene does.
//
// A scene whose timeline moves arms has been seen when the timeline was over, a physical arm had moved for
// kTimelineMotion_s, and all of them were at rest for kRest_s: with lower bounds a motion takes longer than
// the timeline says. Any other scene moves as programs command it: every physical arm must have moved for
// kCommandedMotion_s. An arm that follows another has been seen when it moved itself.
class SeenRun {
 public:
  static constexpr double kMoving = 0.02;         // [rad/s]
  static constexpr double kTimelineMotion_s = 1;  // [s]
  static constexpr double kCommandedMotion_s = 10;
  static constexpr double kRest_s = 0.3;  // longer than the hold in which a stopped run ends

  explicit SeenRun(const Scene& scene);
  void begin(const RecordLayout& layout);  // before the first record
  void take(const CycleRecord& record);    // in order, one thread
  // What the run has not shown, to be printed after "the run "; empty: nothing.
  std::string missing() const;

 private:
  std::vector<std::string> names_;  // of the arms
  std::vector<bool> physical_;
  std::vector<bool> follows_;        // of each arm: it is led from the start, or by the timeline
  std::set<std::string> followers_;  // instances that are led, without commands
  bool timeline_moves_ = false;
  double timeline_ends_s_ = 0;

  std::vector<std::size_t> joints_;
  std::vector<bool> commanded_;   // of each instance: it takes commands
  std::vector<double> moving_s_;  // of each arm
  double t_s_ = 0, rest_s_ = 0;
};

}  // namespace multipanda::cli
