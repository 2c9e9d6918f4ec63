#pragma once

#include <cstddef>
#include <cstdint>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/model/model_terms.hpp"
#include "core/record/record_fields.hpp"
#include "runtime/live_input/request_handler.hpp"
#include "scene/build.hpp"
#include "scene/scene.hpp"

// The state of a world as one row of numbers, which Python sees as arrays.
namespace multipanda {

// Where the numbers of each arm and of each free object lie. An arm has the quantities of
// core/state/arm_sample.hpp by name, then X_WE, `gripper` (width, grasped, moving) and `held`; an object has
// X_WO. Poses are x y z, qw qx qy qz.
class StateRow {
 public:
  static constexpr std::size_t kPose = 7;

  struct Arm {
    std::string name;
    std::size_t joints = 0, first = 0;
    std::vector<RecordField> fields;  // offsets in bytes of the row
  };
  struct Object {
    std::string name;
    std::size_t first = 0;
  };

  explicit StateRow(const Scene& scene);

  std::size_t size() const { return size_; }
  const std::vector<Arm>& arms() const { return arms_; }
  const std::vector<Object>& objects() const { return objects_; }

  void write_arm(std::size_t arm, const ArmSample& sample, const Pose& X_WE, bool held, double* row) const;
  void write_object(std::size_t object, const Pose& X_WO, double* row) const;

 private:
  std::vector<Arm> arms_;
  std::vector<Object> objects_;
  std::size_t size_ = 0;
};

// Everything that determines a world: its beginning and all requests since. A world is computed again from
// it, bit for bit.

// The beginning of a world. Missing values are those of the scene.
struct WorldStart {
  std::uint64_t seed = 1;  // of the noise, and of the hidden plants
  bool hidden = false;     // the simulated arms differ from their models by a draw of the seed
  std::map<std::string, std::vector<double>> q_start;  // by arm [rad]
  std::map<std::string, std::vector<double>> objects;  // by free object: x y z [m], qw qx qy qz
  // Controllets that run from the first cycle on; then the scene's timeline is left out.
  std::optional<std::vector<std::string>> active;
};

// One call of ControlledWorld::command().
struct WorldCommand {
  std::uint64_t cycle = 0;  // cycles completed at its arrival
  nlohmann::json request;
};

struct SavedWorld {
  std::string scene;  // its text
  WorldStart start;
  std::vector<WorldCommand> commands;  // in order
  std::uint64_t cycles = 0;
  std::vector<double> state;  // of that cycle, to check the computed one
  std::string refusal;        // the refusals until then

  std::vector<std::uint8_t> pack() const;
  // Throws std::invalid_argument if pack() did not make these bytes.
  static SavedWorld unpack(const std::uint8_t* bytes, std::size_t size);
};

// What the worlds of a scene share. Throws std::invalid_argument if the scene cannot be built.
struct WorldParts {
  explicit WorldParts(const Scene& scene) : plant(scene), cycle(build_cycle_config(scene, 0)) {}
  PlantParts plant;
  CycleConfig cycle;
};

// A simulated world of a scene with its control loop, stepped by the caller: the program's own run, bit for
// bit, if it gets the same requests at the same cycles. One thread at a time.
class ControlledWorld {
 public:
  // All arguments outlive it. Call reset() first.
  ControlledWorld(const Scene& scene, const Registry& registry, const WorldParts& parts,
                  const StateRow& layout)
      : scene_(scene), registry_(registry), parts_(parts), layout_(layout) {}

  // Builds again what a world changes, with hidden plants its parts, too, and runs the first cycle, so that
  // arms have measured their state. Throws std::invalid_argument: unknown names, wrong sizes, a scene that
  // cannot be built.
  void reset(const WorldStart& start);

  // Sends the world a request, from the next cycle on, as over the socket (docs/live_input.md), to the loop,
  // an arm, a gripper or an object. Throws std::invalid_argument: unknown names, wrong sizes; RequestRefused:
  // what can be refused at once. The rest is decided in the next cycle: refusal().
  void command(nlohmann::json request);

  // Runs the loop. Throws std::runtime_error: the simulation has failed.
  void step(std::uint64_t cycles);
  void refuse(const std::string& what);  // adds to refusal()

  std::uint64_t cycles() const { return cycles_; }  // the first one, of reset(), included
  void write_state(double* row) const;
  // The refusals by the loop and the backend since reset(), the first one first; empty if none.
  const std::string& refusal() const { return refusal_; }
  // Which arms are held, and why; empty if none is.
  std::string held() const;
  // The answer to an arm's newest gripper motion; "" while it moves or without one, "done", or why it failed.
  // A grasp of nothing fails, but is not a refusal.
  std::string gripper_answer(const std::string& arm);
  std::vector<std::string> active() const;

  SavedWorld save() const;
  // Computes the saved world again. Throws std::invalid_argument: it is of another scene, or this computer or
  // program computes different bits.
  void restore(const SavedWorld& saved);

 private:
  void build(const WorldStart& start);
  void execute(const nlohmann::json& request);
  void take(const Request& asked, const nlohmann::json& request);
  [[noreturn]] static void refuse_now(const nlohmann::json& request, std::string_view code,
                                      const std::string& why);
  void ask(const nlohmann::json& request, std::future<RequestAnswer> answer);
  void post_waiting();
  void read_answers();
  void end_grippers();
  bool held(ArmIndex arm) const { return cycle_->modes().owner(arm) == static_cast<InstanceIndex>(arm); }

  struct Asked {
    std::string what;
    std::future<RequestAnswer> answer;
  };

  const Scene& scene_;
  const Registry& registry_;
  const WorldParts& parts_;
  const StateRow& layout_;
  WorldStart start_;
  std::vector<WorldCommand> commands_;
  std::unique_ptr<MujocoBackend> backend_;
  std::unique_ptr<ControlCycle> cycle_;
  std::unique_ptr<RequestHandler> handler_;
  mutable std::vector<ModelTerms> terms_;
  std::vector<Request> waiting_;  // for the next cycle
  std::uint64_t ticket_ = 0;      // of the last one posted; 0: none is unanswered
  std::size_t posted_ = 0;
  std::vector<Asked> asked_;                                 // of the backend
  std::map<ArmIndex, std::future<RequestAnswer>> grippers_;  // motions
  std::map<ArmIndex, std::string> gripper_answers_;
  std::map<ArmIndex, std::optional<GripperRequest>> moving_;  // which a stop ends
  std::string refusal_;
  std::uint64_t cycles_ = 0;
};

}  // namespace multipanda
