#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "backends/arm/request_box.hpp"
#include "backends/mujoco/plant.hpp"
#include "backends/simulation_view.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/pacer.hpp"

namespace multipanda {

enum class Pace : std::uint8_t {
  realtime,  // a step per millisecond of the wall clock
  unpaced,   // as fast as the loop runs
  hosted     // whoever calls has a clock: wait() never sleeps, not even in a paused world
};

struct MujocoOptions {
  Pace pace = Pace::realtime;
  std::filesystem::path meshes;  // shown in pictures in place of the primitives; empty: primitives
};

// A scene in MuJoCo, in lock-step with the loop: the world stands still while the loop computes; after
// write() the next wait() moves it on by one control period of 1 ms in `substeps` physics steps. All arms are
// due in every cycle. docs/simulation.md says what is simulated and what is not.
//
// What is simulated, its determinism and the timeline's `place` events: MujocoPlant.
//
// Requests are taken at the next wait(). Beyond those to the arm: PlaceObject (a free object, at rest;
// refused if it would stand in something), ResetSimulation (everything to the start; loop time goes on; the
// arms report `recovering` for one period, so that the controllets let go), PauseSimulation (the loop goes on
// at the wall clock's pace with the same states, commands are ignored, now() stands still: dt is 0),
// StepSimulation (a paused world carries out so many commands more, then stands still again).
//
// Requests to a gripper (GripperHoming, ... VacuumStop) are answered when the motion is over.
//
// If MuJoCo fails or its state runs away, the world stops, wait() returns nothing from then on and fault()
// says why.
class MujocoBackend : public Backend, public SimulationView {
 public:
  static constexpr double kPeriod = MujocoPlant::kPeriod;  // [s]

  // Throws std::invalid_argument if the scene cannot be built; nothing moves before start().
  explicit MujocoBackend(const Scene& scene, MujocoOptions options = {});

  std::size_t arm_count() const override { return plant_.arm_count(); }
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;
  ArmSet wait() override;
  LoopTime now() const override;
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  // For an arm whose motion is other than torque, before write(), which then leaves it alone.
  void command(ArmIndex arm, const InterfaceCommand& command);
  std::uint64_t overruns() const override { return pace_ == Pace::realtime ? pacer_.overruns() : 0; }
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) override;

  bool failed() const { return plant_.failed(); }
  std::string fault() const override { return plant_.fault(); }
  std::optional<Pose> object_pose(const std::string& name) const override { return plant_.object_pose(name); }

  // For pictures and tests; loop thread, or while the loop stands.
  const World& world() const { return plant_.world(); }
  World& world() { return plant_.world(); }
  const SimulatedArm& arm(ArmIndex i) const { return plant_.arm(i); }
  SimulatedArm& arm(ArmIndex i) { return plant_.arm(i); }

 private:
  void advance();
  void take_requests();
  ArmReply apply(const RequestBox::Posted& posted);
  // The motion of a gripper that a request began; none: the request asks for no such motion, or there is no
  // such gripper.
  struct GripperMotion {
    std::size_t slot = 0;
    ArmIndex arm = 0;
    bool vacuum = false;
    MotionResults::Ticket ticket = 0;
  };
  std::optional<GripperMotion> begin_gripper_motion(const RequestBox::Posted& posted);
  void answer_gripper_motions();

  Pace pace_;
  MujocoPlant plant_;
  Pacer pacer_;
  ArmSet told_;             // arms that command() was called for, in this period
  bool commanded_ = false;  // a period's commands wait to be carried out
  bool paused_ = false;
  std::uint32_t steps_left_ = 0;  // while paused: periods that a request asked for
  std::size_t step_slot_ = 0;     // of that request
  RequestBox requests_;
  std::vector<GripperMotion> gripper_motions_;  // not answered yet; the size never grows in the loop
};

}  // namespace multipanda
