#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "scene/scene.hpp"

namespace multipanda::cli {

bool is_physical(const SceneArm& arm);  // not on this computer

// Whether a run has shown its scene on physical arms. Motion means that a joint moves faster than kMoving
// under a controllet that takes commands: hold and hand guiding do not count.
//
// A scene whose timeline moves arms is complete when the timeline is over, a physical arm has moved for
// kTimelineMotion_s, and all were at rest for kRest_s, because lower bounds delay motions. In other scenes
// programs command the motion: every physical arm must have moved for kCommandedMotion_s. An arm that follows
// another must have moved itself.
class SeenRun {
 public:
  static constexpr double kMoving = 0.02;         // [rad/s]
  static constexpr double kTimelineMotion_s = 1;  // [s]
  static constexpr double kCommandedMotion_s = 10;
  static constexpr double kRest_s = 0.3;  // longer than the final hold of a stopped run

  explicit SeenRun(const Scene& scene);
  void begin(const RecordLayout& layout);  // before the first record
  void take(const CycleRecord& record);    // in order, one thread
  // Missing part of the scene, to be printed after "the run "; empty: none.
  std::string missing() const;

 private:
  std::vector<std::string> names_;  // of the arms
  std::vector<bool> physical_;
  std::vector<bool> follows_;        // of each arm: it follows another arm from the start, or by the timeline
  std::set<std::string> followers_;  // instances that follow an arm, without commands
  bool timeline_moves_ = false;
  double timeline_ends_s_ = 0;

  std::vector<std::size_t> joints_;
  std::vector<bool> commanded_;   // of each instance: it takes commands
  std::vector<double> moving_s_;  // of each arm
  double t_s_ = 0, rest_s_ = 0;
};

// Runs on physical arms with lower bounds for contact: the default of a scene's first run.

enum class Reduction { as_usual, asked, refused };  // neither option, --reduced, --full-speed

class ReducedRun {
 public:
  // `memory`: the file with the scenes that have run; first_runs_file() by default.
  ReducedRun(const Scene& scene, Reduction reduction, std::filesystem::path memory);

  bool reduced() const { return !why_.empty(); }
  const std::string& text() const { return text_; }  // to be printed; empty: none
  void apply(Scene& scene) const;
  // After a successful run with the scene's timeline. Returns why it does not count, to be printed;
  // empty: it counts, or nothing needs to be recorded. If the file cannot be written, the next run is a
  // first one again.
  std::string remember(const SeenRun& seen) const;

  static std::filesystem::path first_runs_file();  // $XDG_STATE_HOME/multipanda/first_runs

 private:
  std::filesystem::path memory_;
  std::string key_;  // of the scene; empty: nothing to record
  std::string why_, text_;
};

}  // namespace multipanda::cli
