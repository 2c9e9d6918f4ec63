#pragma once

#include <string>

#include "core/modes/registry.hpp"
#include "experiments/kinds.hpp"
#include "experiments/person.hpp"
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
  static constexpr double kMargin = 0.02;      // between arms and what they could hit, on that way [m]
  static constexpr double kNear = 0.002;       // an arm this near to its start needs no motion [rad]
  static constexpr double kStartError = 0.05;  // a run that begins farther from its start is stopped [rad]

  ArmSteps(const Experiment& experiment, const ExperimentOptions& options, const ExperimentProgress& progress,
           const Registry& registry)
      : experiment_(experiment), options_(options), progress_(progress), registry_(registry) {}

  // `runs` on arms of `seconds` in total are about to begin; `scene` is the first.
  void check_list(const Scene& scene, std::size_t runs, double seconds);
  // Clears the place if other objects stood there, moves the arms to the scene's start, has the scene's
  // objects placed, and announces the run. `what`: "k10, repeat 1". `extent`: of the run in simulation
  // (MotionExtent).
  void before_run(const Scene& scene, const std::string& what, double seconds,
                  const nlohmann::ordered_json& extent);

 private:
  void ask(const std::string& key, const std::string& text,
           const std::function<bool()>& withdrawn = {}) const;  // throws
  void say(const std::string& text) const;
  void to_start(const Scene& scene, bool cleared);

  const Experiment& experiment_;
  const ExperimentOptions& options_;
  const ExperimentProgress& progress_;
  const Registry& registry_;
  std::string placed_;  // texts of the objects that stand there
  bool cleared_ = false;
};

// Why an arm of a run no longer follows it, by the newest status: "arm 'left' is in mode reflex (...)";
// empty: none. `moved` remembers which arms have been under control.
std::string stopped_arm(const RunStatus& status, std::vector<bool>& moved);

}  // namespace multipanda
