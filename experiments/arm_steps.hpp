#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "experiments/kinds.hpp"
#include "experiments/motion_extent.hpp"
#include "runtime/run_monitor.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// An experiment on arms was stopped by the person or by an arm. Finished runs are kept.
struct ExperimentInterrupted : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The steps around the runs on arms: check-list, objects, motion to the start, announcement of each motion.
// Nothing moves before the person has confirmed it. Every function throws ExperimentInterrupted if the person
// stops or an arm behaves unexpectedly; the arms then hold by themselves.
class ArmSteps {
 public:
  // Speeds on the way to the start: of joints, as a fraction of the slowest joint's limit, and of the hand.
  static constexpr double kStartSpeed = 0.1, kStartHandSpeed = 0.1;  // [1], [m/s]
  static constexpr double kStartLeast_s = 1;                         // shortest duration of that motion
  static constexpr double kMargin = 0.02;      // smallest distance between arms and obstacles during that
                                               // motion [m]
  static constexpr double kNear = 0.002;       // an arm closer than this to its start does not move [rad]
  static constexpr double kStartError = 0.05;  // a run that begins farther than this from its start is
                                               // stopped [rad]

  ArmSteps(const Experiment& experiment, const ExperimentOptions& options, const ExperimentProgress& progress,
           const Registry& registry)
      : experiment_(experiment), options_(options), progress_(progress), registry_(registry) {}

  // Before `runs` on arms that take `seconds` in total; `scene` is the first.
  void check_list(const Scene& scene, std::size_t runs, double seconds);
  // Asks again about equipment and lifted bounds if they differ from the run before. Has objects removed that
  // are not part of the scene or were moved by the arms; moves the arms to the scene's start, has the scene's
  // objects placed, checks that no arm was moved meanwhile, and announces the run. `what`: "k10, repeat 1".
  // `extent`: of the run in simulation (MotionExtent).
  void before_run(const Scene& scene, const std::string& what, double seconds,
                  const nlohmann::ordered_json& extent);

 private:
  void ask(const std::string& key, const std::string& text,
           const std::function<bool()>& withdrawn = {}) const;  // throws
  void say(const std::string& text) const;
  void to_start(const Scene& scene, bool cleared, double near);
  void confirm_set_up(const Scene& scene, const std::string& what);

  const Experiment& experiment_;
  const ExperimentOptions& options_;
  const ExperimentProgress& progress_;
  const Registry& registry_;
  std::string placed_;            // texts of the objects in place
  std::string mounted_, bounds_;  // texts that were confirmed
  bool cleared_ = false;
};

// Why an arm does not take part in its run, from the newest status: "arm 'left' is in mode reflex (...)";
// empty: none. `moved` marks the arms that have been under control: all must be within the first second,
// because otherwise the others would move alone.
std::string stopped_arm(const RunStatus& status, std::vector<bool>& moved);

// Supervises a run on arms from outside the loop: the waiting thread stops all arms if one fails.
class ArmWatch {
 public:
  // `expected`: the extent of its simulation. Throws ExperimentInterrupted if there is none for every arm.
  ArmWatch(const Scene& scene, const RecordLayout& layout,
           const std::vector<std::shared_ptr<const ArmModel>>& models, nlohmann::ordered_json expected);

  void take(const CycleRecord& record);                   // in order, one thread
  std::string trouble(const RunStatus& status);           // set by another thread; empty: no fault
  const MotionExtent& extent() const { return extent_; }  // after the run

 private:
  struct Arm {
    std::string name;
    JointVector start;
    std::size_t hold = 0;  // instance
    bool seen = false, controlled = false;
  };
  std::string look(const CycleRecord& record);

  std::vector<Arm> arms_;
  nlohmann::ordered_json expected_;
  MotionExtent extent_;
  double end_s_ = 0;         // until then no arm may go to hold [s]
  std::vector<bool> moved_;  // used by the calling thread
  std::string what_;         // before `found_`
  std::atomic<bool> found_{false};
};

// What a run is watched for: as the simulation before a run on arms its extent, on arms whatever stops it.
struct RunWatch {
  std::optional<MotionExtent> extent;
  std::optional<ArmWatch> arms;
  std::string trouble;

  void take(const CycleRecord& record) {
    if (extent) extent->take(record);
    if (arms) arms->take(record);
  }
  bool stopped(Session& session);  // stops it at the first fault
  // Throws ExperimentInterrupted with the faults of the run, if it was stopped.
  void check(const std::string& run, const RunSummary& summary) const;
};

}  // namespace multipanda
