#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "backends/gripper/simulated_gripper.hpp"
#include "backends/gripper/simulated_vacuum.hpp"
#include "backends/mujoco/world.hpp"
#include "backends/simulated_arm/friction.hpp"
#include "backends/simulated_arm/from_scene.hpp"
#include "backends/simulated_arm/request_box.hpp"
#include "backends/simulated_arm/simulated_arm.hpp"
#include "core/state/force_sensor.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/time.hpp"
#include "scene/scene.hpp"

namespace multipanda {

struct PlantOptions {
  // For pictures: with what only they show. It costs a seventh of a step, since MuJoCo places it, too.
  bool looks = false;
  // The timeline's `place` events wait for begin_timeline(); otherwise their time counts from construction.
  bool timeline_waits = false;
  // Sensors, the arms' own estimate of forces and friction behind the torque sensors as real arms have them
  // (ArmSensors); not of hidden plants, which have their own.
  bool real_sensors = false;
};

// What the plants of a scene share whatever they start with: files are read and MuJoCo compiles once. Any
// number of threads may build plants from it. Throws std::invalid_argument if the scene cannot be built.
struct PlantParts {
  struct Arm {
    WorldArm of_world;
    SimulatedArmConfig behavior;
    std::optional<JointFriction> friction;
    std::optional<LinkFriction> link_friction;
    JointVector motor_inertia;
    std::optional<GripperLimits> gripper;
  };
  explicit PlantParts(const Scene& scene, const PlantOptions& options = {});
  std::vector<Arm> arms;
  WorldPhysics physics;
  ModelOwner model;
};

// A scene with its arms, ready to be stepped by one control period of 1 ms: MuJoCo's rigid bodies, joint
// friction, and every arm's own behavior between its interface and its motors. It has no clock and no thread:
// its owner (MujocoBackend, or the virtual arms of fci/server) commands the arms and calls advance().
// docs/simulation.md describes what is simulated.
//
// Deterministic: on one machine with the same libraries, the same scene, seed and commands give
// the same bits.
//
// The plant carries out the timeline's `place` events, each at the start of the first period at or after its
// time. It fails if the object would penetrate another.
class MujocoPlant {
 public:
  static constexpr double kPeriod = kArmPeriod;  // [s]

  // Throws std::invalid_argument if the scene cannot be built.
  explicit MujocoPlant(const Scene& scene, const PlantOptions& options = {})
      : MujocoPlant(scene, PlantParts(scene, options), options) {}
  // The same from parts of this scene, which may differ in seed, start positions of arms and free objects,
  // and timeline.
  MujocoPlant(const Scene& scene, const PlantParts& parts, const PlantOptions& options = {});

  std::size_t arm_count() const { return arms_.size(); }
  SimulatedArm& arm(ArmIndex i) { return arms_[i].behavior; }
  const SimulatedArm& arm(ArmIndex i) const { return arms_[i].behavior; }
  // The gripper on the arm's flange, stepped by the plant; nullptr: no such gripper.
  SimulatedGripper* gripper(ArmIndex i) { return arms_[i].gripper ? &*arms_[i].gripper : nullptr; }
  // What the arm's force sensor measures, without noise; nullptr: it has none.
  const ForceReading* force_reading(ArmIndex i) const { return arms_[i].X_FS ? &arms_[i].force : nullptr; }
  SimulatedVacuum* vacuum(ArmIndex i) { return arms_[i].vacuum ? &*arms_[i].vacuum : nullptr; }
  bool has_gripper(ArmIndex i) const { return arms_[i].gripper.has_value(); }
  bool has_vacuum(ArmIndex i) const { return arms_[i].vacuum.has_value(); }
  GripperState gripper_state(ArmIndex i) const;
  // False: uncompensated joint friction acts.
  bool is_frictionless(ArmIndex i) const { return !arms_[i].friction && !arms_[i].link_friction; }

  // Advances one period with the arms' commands and updates their measurements. No allocation, no lock. Does
  // nothing after a failure.
  void advance();
  std::int64_t periods() const { return periods_; }  // executed since construction
  void reset();                                      // everything as at the start, except periods()
  // Any thread: finds the object that the request names, if any. Returns why it cannot; empty: it can.
  std::string locate(const WorldRequest& request, std::size_t& object) const;
  // Moves a free object, at rest. Returns false, changing nothing, if it would penetrate another.
  bool place(std::size_t object, const Pose& X_WO);
  // A force at the object's center of mass from the next period on.
  void push(std::size_t object, const Vector3& f_W, double duration_s);
  // With timeline_waits: sets the timeline's time to 0 in the next period. Later calls do nothing.
  void begin_timeline();

  // True after an engine error, a diverged state or an impossible `place`: the plant then stops.
  bool failed() const { return failed_; }
  const char* fault() const { return fault_.data(); }  // empty: none

  std::optional<Pose> object_pose(const std::string& name) const;  // none: no such object
  const World& world() const { return world_; }
  World& world() { return world_; }

 private:
  struct Arm {
    SimulatedArm behavior;
    std::optional<JointFriction> friction;      // between motors and torque sensors
    std::optional<LinkFriction> link_friction;  // beyond the sensors
    JointVector motor_inertia;                  // before the sensors; empty: none
    std::optional<SimulatedGripper> gripper;
    std::optional<SimulatedVacuum> vacuum;
    JointVector q_start;
    JointVector q, dq;      // of the plant
    JointVector tau_motor;  // in the current physics step
    // The former friction without its part that MuJoCo integrates implicitly, and the slope of that part.
    JointVector friction_explicit, friction_slope;
    PlantMeasurement measurement;  // of the current period
    std::optional<Pose> X_FS;      // of the force sensor; none: there is none
    ForceReading force;
  };
  struct PlannedPlace {
    std::int64_t period = 0;  // the period at whose start it happens
    std::size_t object = 0;
    Pose X_WO;
  };
  struct Push {
    Vector3 f_W = Vector3::Zero();
    std::int64_t periods = -1;  // left; -1: none
  };
  std::string find_free(const std::string& name, const char* done, std::size_t& object) const;
  void apply_pushes();
  void plan_places(const Scene& scene);
  bool carry_out_places();
  void measure_start(ArmIndex arm);
  void drive_grippers(ArmIndex arm);
  void drive(ArmIndex arm, double dt);
  void observe(ArmIndex arm, double weight);
  void feel(bool at_rest);
  void fail(const char* why);

  std::size_t substeps_;
  World world_;
  std::deque<Arm> arms_;
  std::vector<Push> pushes_;          // per object
  std::vector<PlannedPlace> places_;  // by time
  std::size_t next_place_ = 0;
  std::optional<std::int64_t> timeline_origin_ = 0;  // period in which the timeline's time is 0
  bool has_stiction_ = false;
  std::int64_t periods_ = 0;
  bool failed_ = false;
  std::array<char, 512> fault_{};
};

// Contact between tool shapes and objects in SI units (SurfaceContact). Each such pair of geoms is an
// explicit MuJoCo pair, whose values override those of the geoms.
//
// Law. MuJoCo's contact force in one dimension, with constant impedance d and direct solref (-k, -b), is
//   f = (-a - (b/d) v - (k/d) r) / R,  R = (1 - d)/d A,
// where r < 0 is the penetration and A the sum of the two bodies' inverse weights. At rest f = -k r / ((1-d)
// A):
//   k = K (1 - d) A,  b = B (1 - d) A,  along the surface b_t = B_t (1 - d) A / impratio.
// The term with a acts like a mass d / ((1-d) A) of both bodies in contact; d is small.
//
// A box that lies flat on a box or a plane touches at its four corners, so each gets a quarter of K, B and
// B_t, and an impedance that gives four points the added mass of one.

// Name of a tool shape's geom, in the arm's own model: "tool_shape1", ...
std::string tool_shape_name(std::size_t index);

// Pairs every tool shape with every object that has a `contact`; before compilation.
void add_surface_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                       const std::vector<SceneObject>& objects);
// Sets their values, which depend on the compiled inverse weights.
void set_surface_figures(mjModel* model, const std::vector<WorldArm>& arms,
                         const std::vector<SceneObject>& objects);

}  // namespace multipanda
