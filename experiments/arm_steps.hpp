#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "experiments/kinds.hpp"
#include "experiments/motion_extent.hpp"
#include "experiments/person.hpp"
#include "runtime/run_monitor.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// An experiment on arms ended before its end: the person said stop, or an arm did. What was finished stays.
struct ExperimentInterrupted : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The steps around the runs on arms: check-list, objects, the way to the start, the announcement of each
// motion. Nothing moves before the person confirmed it. Every function throws ExperimentInterrupted when the
// person stops, or an arm does not do what is expected; the arms are then held by themselves.
class ArmSteps {
 public:
  // Of joints, as a fraction of the slowest one's limit, and of the hand, on the way to the start.
  static constexpr double kStartSpeed = 0.1, kStartHandSpeed = 0.1;  // [1], [m/s]
  static constexpr double kStartLeast_s = 1;                         // of that way, however short
  static constexpr double kMargin = 0.02;      // between arms and what they could hit, on that way [m]
  static constexpr double kNear = 0.002;       // an arm this near to its start needs no motion [rad]
  static constexpr double kStartError = 0.05;  // a run that begins farther from its start is stopped [rad]

  ArmSteps(const Experiment& experiment, const ExperimentOptions& options, const ExperimentProgress& progress,
           const Registry& registry)
      : experiment_(experiment), options_(options), progress_(progress), registry_(registry) {}

  // `runs` on arms of `seconds` in total are about to begin; `scene` is the first.
  void check_list(const Scene& scene, std::size_t runs, double seconds);
  // Asks again what is mounted and which bounds are lifted, if that differs from the run before. Clears the
  // place if other objects stood there, or objects that the arms have moved; moves the arms to the scene's
  // start, has the scene's objects placed, looks whether an arm was moved meanwhile, and announces the run.
  // `what`: "k10, repeat 1". `extent`: of the run in simulation (MotionExtent).
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
  std::string placed_;            // texts of the objects that stand there
  std::string mounted_, bounds_;  // texts that were confirmed
  bool cleared_ = false;
};

// Why an arm of a run does not follow it, by the newest status: "arm 'left' is in mode reflex (...)"; empty:
// none. `moved` remembers which arms have been under control: all of them must be within the first second,
// since the others would move alone.
std::string stopped_arm(const RunStatus& status, std::vector<bool>& moved);

// Watches a run on arms from beside the loop: whoever waits for its end stops all arms when one has trouble.
class ArmWatch {
 public:
  // `expected`: the extent of its simulation. Throws ExperimentInterrupted if there is none for every arm.
  ArmWatch(const Scene& scene, const RecordLayout& layout,
           const std::vector<std::shared_ptr<const ArmModel>>& models, nlohmann::ordered_json expected);

  void take(const CycleRecord& record);                   // in order, one thread
  std::string trouble(const RunStatus& status);           // another thread; empty: none
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
  double end_s_ = 0;         // no arm goes to hold before [s]
  std::vector<bool> moved_;  // of the thread that asks
  std::string what_;         // before `found_`
  std::atomic<bool> found_{false};
};

}  // namespace multipanda
