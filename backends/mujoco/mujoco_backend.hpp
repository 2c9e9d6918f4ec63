#pragma once

#include <optional>
#include <string>
#include <vector>

#include "backends/mujoco/plant.hpp"
#include "backends/simulated_arm/request_box.hpp"
#include "backends/simulation_view.hpp"
#include "core/cycle/backend.hpp"
#include "core/rt/pacer.hpp"

namespace multipanda {

enum class Pace : std::uint8_t {
  realtime,  // a step per millisecond of the wall clock
  unpaced,   // as fast as the loop runs
  hosted     // the caller provides the clock: wait() never sleeps, even while paused
};

struct MujocoOptions {
  Pace pace = Pace::realtime;
  bool looks = false;  // PlantOptions
};

// A scene in MuJoCo, in lock-step with the loop: the world is paused while the loop computes; after
// write() the next wait() advances it by one control period of 1 ms in `substeps` physics steps. All arms are
// due in every cycle. docs/simulation.md describes what is simulated. See MujocoPlant for its determinism and
// the timeline's `place` events.
//
// The next wait() takes requests. PlaceObject is refused if the object would penetrate another.
// ResetSimulation resets everything except the loop time; the arms report `recovering` for one period, so
// that the controllets are deactivated. During PauseSimulation the loop runs at the wall clock's pace with
// the same states; commands are ignored and now() does not advance (dt is 0). StepSimulation advances a
// paused world by a number of periods.
//
// Requests to a gripper (GripperHoming, ... VacuumStop) get their answers when the motion is over.
//
// If MuJoCo fails or its state diverges, the world stops, wait() returns an empty set and fault()
// returns the reason.
class MujocoBackend : public Backend, public SimulationView {
 public:
  static constexpr double kPeriod = MujocoPlant::kPeriod;  // [s]

  // Throws std::invalid_argument if the scene cannot be built; nothing moves before start().
  explicit MujocoBackend(const Scene& scene, MujocoOptions options = {})
      : MujocoBackend(scene, options, PlantParts(scene, {.looks = options.looks})) {}
  MujocoBackend(const Scene& scene, MujocoOptions options, const PlantParts& parts);

  std::size_t arm_count() const override { return plant_.arm_count(); }
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;
  ArmSet wait() override;
  LoopTime now() const override;
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  const ForceReading* force_reading(ArmIndex arm) override { return plant_.force_reading(arm); }
  // Commands an arm whose motion is not torque. Call it before write(), which then skips the arm.
  void command(ArmIndex arm, const InterfaceCommand& command);
  std::uint64_t overruns() const override { return pace_ == Pace::realtime ? pacer_.overruns() : 0; }
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;
  std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request) override;
  std::future<RequestAnswer> request(WorldRequest request) override;

  bool failed() const { return plant_.failed(); }
  std::string fault() const override { return plant_.fault(); }
  std::optional<Pose> object_pose(const std::string& name) const override { return plant_.object_pose(name); }

  // For pictures and tests; from the loop thread, or while the loop is stopped.
  const World& world() const { return plant_.world(); }
  World& world() { return plant_.world(); }
  const SimulatedArm& arm(ArmIndex i) const { return plant_.arm(i); }
  SimulatedArm& arm(ArmIndex i) { return plant_.arm(i); }

 private:
  void advance();
  void take_requests();
  ArmReply apply(const RequestBox::Posted& posted);
  ArmReply apply_to_world(const RequestBox::Posted& posted, const WorldRequest& request);
  ArmReply apply_to_gripper(ArmIndex arm, const GripperRequest& request);
  // The gripper motion started by a request. None if the request is not a motion, or the arm has no
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
  ArmSet told_;             // arms commanded by command() in this period
  bool commanded_ = false;  // commands are ready for the next period
  bool paused_ = false;
  std::uint32_t steps_left_ = 0;  // remaining requested periods while paused
  std::size_t step_slot_ = 0;     // slot of that request
  RequestBox requests_;
  std::vector<GripperMotion> gripper_motions_;  // unanswered ones; the size never grows in the loop
};

}  // namespace multipanda
