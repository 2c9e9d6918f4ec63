#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "commission/arms_run.hpp"
#include "commission/measures.hpp"
#include "common/person.hpp"
#include "core/modes/registry.hpp"
#include "scene/scene.hpp"

namespace multipanda::commission {

// The arms of a tour and its settings.
struct TourSetup {
  Scene scene;                         // with the arms' addresses (SceneArm::fci)
  std::string scene_name;              // as given: "two_arms", or a path
  std::vector<std::string> addresses;  // per arm
  std::filesystem::path folder;        // of commission.json and the page
  double seconds = 10;                 // of each measurement of computer and network
  bool paced = true;                   // false: virtual arms in lock-step, as fast as they run
};

// Context of a step.
struct Context {
  const TourSetup& setup;
  Person& person;
  const Registry& registry;
  std::function<void(const std::string&)> say;  // shows a line to the person
  std::function<bool()> stopped;                // Ctrl-C; any thread
  std::unique_ptr<ArmsRun> run;                 // from the step `hold` on

  const SceneArm& arm(ArmIndex i) const { return setup.scene.arms[i]; }
  std::size_t arm_count() const { return setup.scene.arms.size(); }
  bool virtual_arms() const;   // all addresses are of this computer
  void check_stopped() const;  // throws Person::Ended
};

// One step, announced before it begins; its limits are in limits.hpp.
struct Step {
  std::string id, title;
  std::string about;   // what will move, how far and how fast; what the person does
  bool moves = false;  // the step moves an arm, by itself or by the person
  // Repeated in a resumed tour, because its result may have changed or because it begins the hold.
  bool every_time = false;
  std::function<StepResult(Context&)> run;
};

// A step's work for each arm in turn, until a no-go: `work` fills the result.
StepResult each_arm(Context& context,
                    const std::function<void(ArmIndex, const std::string& name, StepResult& result)>& work);

// All steps for these arms, in order.
std::vector<Step> steps_of(const TourSetup& setup);
void add_steps_at_rest(std::vector<Step>& steps, const TourSetup& setup);
void add_steps_in_hold(std::vector<Step>& steps, const TourSetup& setup);
void add_steps_in_motion(std::vector<Step>& steps, const TourSetup& setup);
void add_steps_between_arms(std::vector<Step>& steps, const TourSetup& setup);

struct TourEnd {
  Verdict verdict = Verdict::go;
  std::string step;  // that ended it; empty: all were done
  Json state;        // as in commission.json
};

// Runs the steps that `state` does not have yet, each after the person's key, and writes commission.json
// after each. A no-go, the person's end, or an arm that left its control ends the tour: no later step runs.
// The arms are in hold between the steps; at the end they hold themselves. `show`: called with each result.
TourEnd run_tour(Context& context, Json state, const std::function<void(const Step&, const Json&)>& show);

// The initial state of a tour.
Json new_state(const TourSetup& setup);
// The same measurements on the scene's simulated arms, from the arms' positions, for comparison on the page.
// Adds "twin" to the state. Throws ArmLeft.
void measure_twin(const TourSetup& setup, const Registry& registry, Json& state);
// commission.html from the state; throws std::runtime_error.
std::filesystem::path make_page(const std::filesystem::path& folder);
void write_state(const std::filesystem::path& folder, const Json& state);

}  // namespace multipanda::commission
