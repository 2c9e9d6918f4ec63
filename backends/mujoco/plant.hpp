#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "backends/arm/link_friction.hpp"
#include "backends/arm/request_box.hpp"
#include "backends/arm/simulated_arm.hpp"
#include "backends/gripper/simulated_gripper.hpp"
#include "backends/gripper/simulated_vacuum.hpp"
#include "backends/mujoco/world.hpp"
#include "core/types/arm_set.hpp"
#include "scene/scene.hpp"

namespace multipanda {

struct PlantOptions {
  std::filesystem::path meshes;  // shown in pictures in place of the primitives; empty: primitives
  // The timeline's `place` events wait for begin_timeline(); else they count from the plant's beginning.
  bool timeline_waits = false;
};

// A scene with its arms, ready to be stepped by one control period of 1 ms: MuJoCo's rigid bodies, joint
// friction, and every arm's own behaviour between its interface and its motors. It has no clock and no
// thread; whoever owns it (MujocoBackend, the virtual arms of fci/server) gives the arms their commands and
// calls advance(). docs/simulation.md says what is simulated and what is not.
//
// Deterministic: the same scene, seed and commands give the same bits, on the same machine and libraries.
//
// Events `place` of the scene's timeline are carried out here, each at the beginning of the first period that
// does not begin before its time; where the object would stand inside something the plant fails.
class MujocoPlant {
 public:
  static constexpr double kPeriod = 0.001;  // [s]

  // Throws std::invalid_argument if the scene cannot be built.
  explicit MujocoPlant(const Scene& scene, const PlantOptions& options = {});

  std::size_t arm_count() const { return arms_.size(); }
  SimulatedArm& arm(ArmIndex i) { return arms_[i].behaviour; }
  const SimulatedArm& arm(ArmIndex i) const { return arms_[i].behaviour; }
  // What hangs on the arm's flange and moves; nullptr: no such gripper. The plant steps it.
  SimulatedGripper* gripper(ArmIndex i) { return arms_[i].gripper ? &*arms_[i].gripper : nullptr; }
  SimulatedVacuum* vacuum(ArmIndex i) { return arms_[i].vacuum ? &*arms_[i].vacuum : nullptr; }
  bool has_gripper(ArmIndex i) const { return arms_[i].gripper.has_value(); }
  bool has_vacuum(ArmIndex i) const { return arms_[i].vacuum.has_value(); }
  GripperState gripper_state(ArmIndex i) const;
  // False: joint friction acts that nobody compensates.
  bool is_frictionless(ArmIndex i) const { return !arms_[i].friction && !arms_[i].link_friction; }

  // One period, by the commands that the arms were given; then every arm has measured. No allocation, no
  // lock. Nothing happens after a failure.
  void advance();
  std::int64_t periods() const { return periods_; }  // carried out since construction
  void reset();                                      // everything to the start; periods() goes on
  // Any thread: finds the object that a PlaceObject names. Why it cannot be placed, or nothing.
  std::string locate(RequestBox::Posted& posted) const;
  // With timeline_waits: the timeline's time is 0 in the period that comes next. Once; later calls do
  // nothing.
  void begin_timeline();

  // A failed engine, a state that ran away, an impossible `place`: the plant stands still from then on.
  bool failed() const { return failed_; }
  const char* fault() const { return fault_.data(); }  // empty: none

  std::optional<Pose> object_pose(const std::string& name) const;  // none: no such object
  const World& world() const { return world_; }
  World& world() { return world_; }

 private:
  struct Arm {
    SimulatedArm behaviour;
    std::optional<JointFriction> friction;      // between motors and torque sensors
    std::optional<LinkFriction> link_friction;  // beyond the sensors
    JointVector motor_inertia;                  // before the sensors; empty: none
    std::optional<SimulatedGripper> gripper;
    std::optional<SimulatedVacuum> vacuum;
    JointVector q_start;
    JointVector q, dq;      // of the plant
    JointVector tau_motor;  // in the present physics step
    // The former friction less its part that MuJoCo integrates implicitly, and that part's slope.
    JointVector friction_explicit, friction_slope;
    PlantMeasurement measurement;  // of the present period
  };
  struct PlannedPlace {
    std::int64_t period = 0;  // at the beginning of which it happens
    std::size_t object = 0;
    Pose X_WO;
  };
  void plan_places(const Scene& scene);
  bool carry_out_places();
  void measure_start(ArmIndex arm);
  void drive_grippers(ArmIndex arm);
  void drive(ArmIndex arm, double dt);
  void observe(ArmIndex arm, double weight);
  void fail(const char* why);

  std::size_t substeps_;
  World world_;
  std::deque<Arm> arms_;
  std::vector<PlannedPlace> places_;  // by time
  std::size_t next_place_ = 0;
  std::optional<std::int64_t> timeline_origin_ = 0;  // period in which the timeline's time is 0
  bool has_stiction_ = false;
  std::int64_t periods_ = 0;
  bool failed_ = false;
  std::array<char, 512> fault_{};
};

}  // namespace multipanda
